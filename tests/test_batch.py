"""One recipe, many scenes: what is finished is known, what is not is done, and what fails stops nothing else."""

import csv
import json
import os
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from deglint import remove_glint
from deglint.batch import jobs_of, read_config, run_batch, state_of
from deglint.errors import InputError, ReadError, WriteError
from deglint.pipeline.outputs import BESIDE
from deglint.raster.targets import claimed
from deglint.readers.scenes import ListedScene, list_scenes

from .common import says

RECIPE = """
[recipe]
method = "hedley"
sample = "all"
mask = "none"
[output]
directory = "{out}"
name = "{{name}}_clean.tif"
extras = {extras}
"""


@pytest.fixture
def place(tmp_path, sea, write):
    """A directory with scenes a, b, c and a recipe for them."""
    (tmp_path / "in").mkdir()
    for i, name in enumerate("abc"):
        write(tmp_path / "in" / f"{name}.tif", sea(seed=i))
    (tmp_path / "r.toml").write_text(RECIPE.format(out=tmp_path / "out", extras="[]"))
    return tmp_path


def made(place):
    """Outputs, by name, with when they were written."""
    return {p.name: p.stat().st_mtime_ns for p in (place / "out").iterdir()}


def batch(deglint, place, *arguments, code=0):
    ran = deglint("batch", place / "r.toml", place / "in" / "*.tif", "--json", *arguments)
    assert ran.code == code, ran.err
    return {row["name"]: row for row in json.loads(ran.out)}, ran.err


@pytest.mark.slow
def test_all_scenes_are_done_as_one_by_one_and_then_never_again(deglint, place, read):
    rows, said = batch(deglint, place, "--jobs", "2", "--table", place / "t.csv")
    assert [r["status"] for r in rows.values()] == ["done"] * 3
    assert all(r["corrected"] == 1 and r["method"] == "hedley" for r in rows.values())
    assert said.count("\n") == 3
    assert "[3/3]" in said
    for name in "abc":
        alone = deglint("remove", place / "in" / f"{name}.tif", place / "one.tif", "--overwrite", "--method", "hedley",
                        "--sample", "all", "--mask", "none")  # fmt: skip
        assert alone.code == 0
        np.testing.assert_array_equal(read(place / "one.tif"), read(place / "out" / f"{name}_clean.tif"))
    before = made(place)
    assert sorted(before) == sorted(f"{n}_clean.tif{e}" for n in "abc" for e in ("", ".json"))
    rows, _ = batch(deglint, place, "--table", place / "t.csv", "--overwrite")
    assert [r["status"] for r in rows.values()] == ["finished before"] * 3
    assert made(place) == before
    with (place / "t.csv").open() as file:
        assert [row["status"] for row in csv.DictReader(file)] == ["finished before"] * 3


@pytest.mark.slow
def test_one_bad_scene_does_not_stop_the_rest(deglint, place):
    whole = (place / "in" / "b.tif").read_bytes()
    (place / "in" / "b.tif").write_bytes(whole[:9000])
    rows, said = batch(deglint, place, code=1)
    assert [r["status"] for r in rows.values()] == ["done", "failed", "done"]
    assert "truncated or damaged" in rows["b"]["reason"]
    assert "b failed: " in said
    ran = deglint("batch", place / "r.toml", place / "in" / "*.tif", "-q")
    assert ran.code == 1
    assert ran.err == ""
    assert ran.out.endswith("3 scenes: 2 finished before, 1 failed\n")
    (place / "in" / "b.tif").write_bytes(whole)
    rows, _ = batch(deglint, place)
    assert [r["status"] for r in rows.values()] == ["finished before", "done", "finished before"]


def test_a_scene_without_water_is_an_answer_and_no_failure(deglint, place, write):
    source = write(place / "d.tif", np.zeros((4, 60, 60), np.uint16), nodata=0)
    (place / "r.toml").write_text(f'[output]\ndirectory = "{place / "out"}"\n')
    ran = deglint("batch", place / "r.toml", source, "-q")
    assert ran.code == 0
    assert ran.out.endswith("1 scene: 1 no water\n")
    assert made(place) == {}


@pytest.mark.slow
def test_what_was_made_otherwise_is_left_alone_unless_told(deglint, place, sea, write):
    batch(deglint, place)
    before = made(place)
    write(place / "in" / "a.tif", sea(seed=9))  # the same size, other pixels
    (place / "out" / "b_clean.tif").write_bytes(b"mine")
    (place / "out" / "c_clean.tif.json").unlink()
    rows, _ = batch(deglint, place, code=1)
    reasons = [r["reason"] for r in rows.values()]
    assert "scene was changed" in reasons[0]
    assert "was changed after it was made" in reasons[1]
    assert "was not made by this batch" in reasons[2]
    assert all("--overwrite" in r for r in reasons)
    assert (place / "out" / "b_clean.tif").read_bytes() == b"mine"
    rows, _ = batch(deglint, place, "--overwrite")
    assert [r["status"] for r in rows.values()] == ["done"] * 3
    assert made(place).keys() == before.keys()
    text = (place / "r.toml").read_text()
    (place / "r.toml").write_text(text.replace('"hedley"', '"joyce"'))
    rows, _ = batch(deglint, place, code=1)
    assert all("made by another recipe" in r["reason"] for r in rows.values())


def test_a_copy_is_known_by_its_checksum_and_a_changed_pixel_is_seen(deglint, place):
    batch(deglint, place)
    for path in [*(place / "out").iterdir(), *(place / "in").iterdir()]:
        os.utime(path, ns=(1, 1))  # as after a copy that keeps no times
    rows, _ = batch(deglint, place)
    assert [r["status"] for r in rows.values()] == ["finished before"] * 3
    path = place / "out" / "a_clean.tif"
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    rows, _ = batch(deglint, place, code=1)
    assert "was changed after it was made" in rows["a"]["reason"]


def test_a_mask_that_was_drawn_anew_is_another_recipe(place, geojson):
    (place / "r.toml").write_text(f'[recipe]\nmask = "{place / "m.geojson"}"\n')
    geojson(place / "m.geojson", [(0, 0), (1, 0), (1, 1)])
    first = read_config(str(place / "r.toml")).request()
    assert read_config(str(place / "r.toml")).request() == first
    geojson(place / "m.geojson", [(0, 0), (2, 0), (1, 1)])
    assert read_config(str(place / "r.toml")).request() != first


def test_a_dry_run_does_nothing(deglint, place):
    rows, _ = batch(deglint, place, "--dry-run")
    assert [r["status"] for r in rows.values()] == ["to do"] * 3
    assert not (place / "out").exists()


@pytest.mark.slow
def test_extras_go_where_their_names_say(deglint, place):
    extras = '["flags", "amount", "stderr", "picture", "sample", "model"]'
    (place / "r.toml").write_text(RECIPE.format(out=place / "out", extras=extras))
    (place / "in" / "b.tif").unlink()
    (place / "in" / "c.tif").unlink()
    batch(deglint, place)
    assert set(made(place)) == {
        "a_clean.tif", "a_clean.tif.json", "a_clean_flags.tif", "a_clean_amount.tif", "a_clean_picture.png",
        "a_clean_stderr.tif",
        "a_clean_sample.geojson", "a_clean_model.json", "a_clean_flags.tif.aux.xml",
    }  # fmt: skip
    (place / "out" / "a_clean_flags.tif").unlink()  # as if the run had been killed between two moves
    rows, _ = batch(deglint, place)
    assert [r["status"] for r in rows.values()] == ["done"]


def test_every_optional_output_is_an_extra(place):
    (place / "r.toml").write_text(RECIPE.format(out=place / "out", extras=json.dumps([*BESIDE])))
    job, *_ = jobs_of(read_config(str(place / "r.toml")), list_scenes([str(place / "in" / "a.tif")]))
    assert all(getattr(job.outputs, name).stem == f"a_clean_{name}" for name in BESIDE)


def test_names_that_clash_are_told_before_anything_is_done(place, write, sea):
    config = read_config(str(place / "r.toml"))
    (place / "in2").mkdir()
    write(place / "in2" / "a.tif", sea())
    with pytest.raises(InputError, match=r"several scenes.*a_clean\.tif: .*in/a\.tif, .*in2/a\.tif"):
        run_batch(config, list_scenes([str(place / "in" / "a.tif"), str(place / "in2" / "a.tif")]))
    assert not (place / "out").exists()
    text = (place / "r.toml").read_text().replace(str(place / "out"), str(place / "in")).replace("_clean", "")
    (place / "r.toml").write_text(text)
    with pytest.raises(InputError, match="would be written over"):
        jobs_of(read_config(str(place / "r.toml")), list_scenes([str(place / "in" / "*.tif")]))


def test_two_batches_do_not_work_in_one_directory(deglint, place):
    (place / "out").mkdir()
    with claimed(place / "out"):
        ran = deglint("batch", place / "r.toml", place / "in" / "a.tif")
    assert ran.code == 1
    assert ran.err.startswith("Error: another batch is writing into ")
    assert ran.err.count("\n") == 1
    assert not list((place / "out").iterdir())
    with claimed(place / "out"), pytest.raises(WriteError, match="another batch"), claimed(place / "out"):
        pass


def test_a_lock_that_its_batch_removed_at_the_end_is_taken_anew(tmp_path, monkeypatch):
    fcntl = pytest.importorskip("fcntl")
    lock, file, late = fcntl.flock, tmp_path / ".deglint-batch.lock", [True, False, False]

    def flock(*given):
        if late.pop(0):
            file.unlink()
        lock(*given)

    monkeypatch.setattr(fcntl, "flock", flock)
    with claimed(tmp_path):
        assert file.exists()
        with pytest.raises(WriteError, match="another batch is writing"), claimed(tmp_path):
            pass
    assert not file.exists()


def test_a_table_replaces_nothing_but_a_table(deglint, place):
    ran = deglint("batch", place / "r.toml", place / "in" / "a.tif", "--table", place / "in" / "b.tif")
    assert ran.code == 1
    assert "b.tif exists already" in ran.err
    assert not (place / "out").exists()


@pytest.mark.parametrize("name", ["a_clean.tif", "a_clean.tif.json"])
def test_a_table_is_none_of_the_images(deglint, place, name):
    (place / "out").mkdir()
    table = place / "out" / name
    ran = deglint("batch", place / "r.toml", place / "in" / "a.tif", "--table", table, "--overwrite")
    assert ran.code == 1
    assert f"{name} is an output: " in ran.err
    assert not list((place / "out").iterdir())


def test_a_dry_run_keeps_the_table(deglint, place):
    text = "name,inputs,output,status,reason,seconds,\n"
    (place / "t.csv").write_text(text)
    batch(deglint, place, "--dry-run", "--table", place / "t.csv")
    assert (place / "t.csv").read_text() == text


@pytest.fixture
def finished(place):
    """A job that is done, with flags."""
    (place / "r.toml").write_text(RECIPE.format(out=place / "out", extras='["flags"]'))
    config = read_config(str(place / "r.toml"))
    job = jobs_of(config, list_scenes([str(place / "in" / "a.tif")]))[0]
    (place / "out").mkdir()
    remove_glint(job.scene.source, job.outputs, config.recipe)
    assert state_of(job) == ("finished before", "")
    return job


def test_an_altered_image_whose_flags_are_gone_is_kept(finished):
    finished.outputs.image.write_bytes(b"mine")
    finished.outputs.flags.unlink()
    assert state_of(finished) == ("failed", f"{finished.outputs.image} was changed after it was made")


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("outputs", {}, "was changed after it was made"),
        ("outputs", [], "not made by this batch"),
        ("inputs", None, "not made by"),
    ],
)
def test_a_sidecar_that_knows_not_all_fails_its_scene_alone(finished, key, value, said):
    document = json.loads(finished.outputs.sidecar.read_text())
    document["batch"][key] = value
    finished.outputs.sidecar.write_text(json.dumps(document))
    assert said in state_of(finished)[1]
    del document["batch"]["request"]
    finished.outputs.sidecar.write_text(json.dumps(document))
    assert "not made by this batch" in state_of(finished)[1]


CRASH = """
    import os, signal, sys
    import deglint.batch as workers
    whole = workers.remove_glint
    def remove(paths, *arguments, **options):
        if paths[0].endswith("b.tif"):
            os.kill(os.getpid(), signal.{how})
        return whole(paths, *arguments, **options)
    workers.remove_glint = remove
    if __name__ == "__main__":
        from deglint.cli import run
        sys.exit(run(sys.argv[1:]))
"""


@pytest.mark.slow
def test_a_scene_that_ends_its_process_ends_no_other(place):
    how = "SIGKILL"  # as the system does where memory runs out
    (place / "run.py").write_text(textwrap.dedent(CRASH).format(how=how))
    done = subprocess.run(
        [sys.executable, str(place / "run.py"), "batch", str(place / "r.toml"), str(place / "in" / "*.tif"), "--json"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    rows = json.loads(done.stdout)
    assert done.returncode == 1
    assert [r["status"] for r in rows] == ["done", "failed", "done"]
    assert how in rows[1]["reason"]
    assert "Traceback" not in done.stderr


SLOW = """
    import sys, time
    from deglint.raster.output import RasterWriter
    write = RasterWriter.write
    def slowly(self, block, window):
        write(self, block, window)
        print("writing", self.target.name, flush=True)
        if self.target.name.startswith("b"):
            time.sleep(30)
    RasterWriter.write = slowly
    if __name__ == "__main__":
        from deglint.cli import run
        sys.exit(run(sys.argv[1:]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL], ids=["kill", "kill -9"])
def test_a_batch_that_is_stopped_goes_on_where_it_was(deglint, place, how):
    """Half of b is written when the batch ends; its workers end too, and nothing half is left that counts."""
    (place / "run.py").write_text(textwrap.dedent(SLOW))
    call = [sys.executable, str(place / "run.py"), "batch", str(place / "r.toml"), str(place / "in" / "*.tif")]
    with subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        while running.stdout.readline() != "writing b_clean.tif\n":
            pass
        first = made(place)
        running.send_signal(how)
        running.stdout.read()  # until the worker has ended, too
        said = running.stderr.read()
    assert "Traceback" not in said
    assert running.returncode == (130 if how == signal.SIGTERM else -9)
    assert set(made(place)) - {".deglint-batch.lock"} == {"a_clean.tif", "a_clean.tif.json"}
    rows, _ = batch(deglint, place)
    assert [r["status"] for r in rows.values()] == ["finished before", "done", "done"]
    assert made(place)["a_clean.tif"] == first["a_clean.tif"]
    assert not [name for name in made(place) if name.startswith(".")]


def test_a_worker_that_was_killed_leaves_scratch_that_the_next_batch_removes(deglint, place):
    (place / "out").mkdir()
    token = "999999999-0123abcd"
    ours, another = f".a_clean.tif.{token}.part.tif", f".z_clean.tif.{token}.part.tif"
    for name in (ours, f"{ours}.aux.xml", another):
        (place / "out" / name).write_bytes(b"half")
    batch(deglint, place)
    assert {n for n in made(place) if n.startswith(".")} == {another}


def test_a_kill_between_the_moves_is_no_finished_scene(deglint, place):
    batch(deglint, place)
    config = read_config(str(place / "r.toml"))
    job = jobs_of(config, [ListedScene("a", (str(place / "in" / "a.tif"),))])[0]
    assert state_of(job)[0] == "finished before"
    job.outputs.image.unlink()  # the sidecar is moved first
    state, why = state_of(job)
    assert (state, says(why, "stopped", "in place")) == ("to do", True)
    job.outputs.image.write_bytes(b"old")  # of an older run that was to be replaced
    assert state_of(job)[0] == "failed"


def test_scenes_from_csv_and_stac(place):
    (place / "list.csv").write_text(f"name,path\nfirst,{place}/in/a.tif;{place}/in/b.tif\n,{place}/in/c.tif\n")
    found = list_scenes([str(place / "list.csv")])
    assert [s.name for s in found] == ["first", "c"]
    assert found[0].paths == (f"{place}/in/a.tif", f"{place}/in/b.tif")
    assets = {
        "thumb": {"href": "t.png", "type": "image/png"},
        "data": {"href": "in/a.tif", "type": "image/tiff; application=geotiff", "roles": ["data"]},
        "B08": {"href": "https://example.com/b8.tif", "type": "image/tiff"},
    }
    item = {"type": "Feature", "stac_version": "1.0.0", "id": "tile 7", "assets": assets}
    (place / "items.json").write_text(json.dumps({"type": "FeatureCollection", "features": [item]}))
    assert list_scenes([str(place / "items.json")]) == [ListedScene("tile 7", (str(place / "in" / "a.tif"),))]
    both = list_scenes([str(place / "items.json")], assets=("B08", "data"))
    assert both[0].paths == ("https://example.com/b8.tif", str(place / "in" / "a.tif"))
    with pytest.raises(InputError, match=r"no asset B04.*thumb, data, B08.*assets in \[input\]"):
        list_scenes([str(place / "items.json")], assets=("B04",))
    with pytest.raises(ReadError, match="no file fits"):
        list_scenes([str(place / "*.jp2")])


def test_a_csv_of_scenes_in_two_files_each_runs(deglint, place, sea, write):
    for i, name in enumerate(("nir", "green")):
        write(place / f"{name}.tif", sea()[[3 - 2 * i]], names=[name])
    (place / "list.csv").write_text(f"path,name\n{place}/green.tif;{place}/nir.tif,pair\n")
    ran = deglint("batch", place / "r.toml", place / "list.csv", "-q")
    assert ran.code == 0, ran.err
    assert (place / "out" / "pair_clean.tif").exists()
    assert "finished before" in deglint("batch", place / "r.toml", place / "list.csv", "-q").out


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[recipe]\nmethod = 'magic'", "method 'magic' is not one of auto, .*hedley"),
        ("[recipe]\nmetod = 'joyce'", r"\[recipe\] metod is not one of bands, compensate"),
        ("[recipe]\nfloor_percentile = 'much'", "want a number"),
        ("[recipe]\nbands = {a = 1}", "bands: want a band by name"),
        ("[recipe]\nnir = true", "nir: want a band by name"),
        ("[output]\nname = 'out.tif'", "must hold {name}"),
        ("[output]\nname = '../{name}.tif'", "no file name can be made"),
        ("[output]\nextras = ['magic']", "is not one of flags, amount"),
        ("[output]\ndtype = 'complex64'", "is not one of float32"),
        ("[output]\noptions = ['a']", "options: want a dict"),
        ("[outputs]\n", "is not one of the tables"),
        ("recipe = 3", "is not one of the tables"),
        ("[recipe", "is not TOML"),
    ],
)
def test_a_recipe_that_is_wrong_says_where(tmp_path, text, said):
    (tmp_path / "r.toml").write_text(text)
    with pytest.raises(InputError, match=said) as error:
        read_config(str(tmp_path / "r.toml"))
    assert "r.toml" in str(error.value)


def test_an_empty_recipe_is_one(tmp_path):
    (tmp_path / "r.toml").write_text("")
    config = read_config(str(tmp_path / "r.toml"))
    assert config.recipe.method == "auto"
    assert config.name == "{name}_deglinted.tif"


def test_progress_of_the_whole(place):
    heard = []
    config = read_config(str(place / "r.toml"))
    found = run_batch(config, list_scenes([str(place / "in" / "*.tif")]), done=heard.append)
    assert heard == found
    assert [o.status for o in found] == ["done"] * 3
