"""An output never replaces a file that is read, whatever it is called and whoever reads it; nor another output."""

import importlib
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import rasterio.shutil

from deglint import remove_glint
from deglint.batch import jobs_of, read_config, state_of
from deglint.checksum import Checksum, are_as
from deglint.errors import InputError, ReadError
from deglint.raster.targets import check_targets, files_behind
from deglint.readers.scenes import list_scenes

from .common import HEDLEY, NAMES, RUN, write_vrt


def mosaic(path, source, bands=4):
    """A VRT of the bands of a scene."""
    write_vrt(path, 80, 100, source, bands=range(1, bands + 1), names=NAMES[:bands])


@pytest.fixture
def scene(sea, write, geojson, tmp_path):
    """A folder with a scene, what reads it, and what a run reads beside it."""
    write(tmp_path / "src.tif", sea())
    mosaic(tmp_path / "v.vrt", "src.tif")
    mosaic(tmp_path / "deep.vrt", "v.vrt")
    (tmp_path / "link.tif").symlink_to("src.tif")
    os.link(tmp_path / "src.tif", tmp_path / "hard.tif")
    write(tmp_path / "m.tif", np.ones((1, 80, 100), np.uint8), names=None)
    mosaic(tmp_path / "m.vrt", "m.tif", bands=1)
    whole = [(400_000, 800_000), (401_000, 800_000), (401_000, 799_200), (400_000, 799_200)]
    geojson(tmp_path / "s.geojson", whole, crs="EPSG:32653")
    return tmp_path


def contents(folder):
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}


SPELLINGS = [
    ("src.tif", "src.tif"), ("src.tif", "./src.tif"), ("src.tif", "x/../src.tif"), ("src.tif", "link.tif"),
    ("link.tif", "src.tif"), ("src.tif", "hard.tif"), ("v.vrt", "src.tif"), ("deep.vrt", "src.tif"),
    ("deep.vrt", "v.vrt"), ("deep.vrt", "link.tif"), ("vrt://src.tif?bands=1,2,3,4", "src.tif"), ("src.tif", "-"),
]  # fmt: skip


@pytest.mark.parametrize("overwrite", [(), ("--overwrite",)], ids=["", "overwrite"])
@pytest.mark.parametrize(("source", "output"), SPELLINGS)
def test_remove_never_replaces_what_it_reads(deglint, scene, monkeypatch, source, output, overwrite):
    monkeypatch.chdir(scene)
    (scene / "x").mkdir()
    before = contents(scene)
    ran = deglint("remove", source, output, *RUN, *overwrite)
    assert ran.code == 1
    assert ("would be lost" in ran.err) != (output == "-")
    assert "--overwrite" not in ran.err
    assert ran.err.count("\n") == 1
    assert contents(scene) == before


@pytest.mark.parametrize("option", ["--flags", "--amount", "--save-model", "--picture", "--save-sample", "--stderr"])
@pytest.mark.parametrize(
    ("source", "output"), [("src.tif", "link.tif"), ("deep.vrt", "src.tif"), ("src.tif", "src.tif")]
)
def test_nothing_beside_the_image_replaces_what_is_read(deglint, scene, monkeypatch, option, source, output):
    monkeypatch.chdir(scene)
    before = contents(scene)
    ran = deglint("remove", source, "out.tif", *RUN, "--overwrite", option, output)
    assert ran.code == 1
    assert "would be lost" in ran.err
    assert contents(scene) == before


@pytest.mark.parametrize(
    "arguments",
    [("--mask", "m.tif", "--flags", "m.tif"), ("--mask", "m.vrt", "--amount", "m.tif"),
     ("--sample", "s.geojson", "--save-sample", "s.geojson"), ("--model", "model.json", "--save-model", "model.json"),
     ("--mask", "m.tif", "--picture", "m.tif"), ("--sample", "out.tif.json")],
)  # fmt: skip
def test_what_is_read_beside_the_scene_stays(deglint, scene, monkeypatch, arguments):
    monkeypatch.chdir(scene)
    shutil.copy("s.geojson", "out.tif.json")
    assert deglint("remove", "src.tif", "o.tif", *RUN, "--save-model", "model.json").code == 0
    before = contents(scene)
    ran = deglint("remove", "src.tif", "out.tif", "--overwrite", *arguments)
    assert ran.code == 1
    assert "would be lost" in ran.err
    assert contents(scene) == before


@pytest.mark.parametrize(
    ("one", "said"),
    [("o.tif", "same name"), ("o.tif.json", "same name"), ("o.tif.msk", "a part of"), ("o.tif.aux.xml", "a part of"),
     ("src.tif.msk", "a part of"), ("src.tif.ovr", "a part of")],
)  # fmt: skip
def test_outputs_do_not_collide_nor_become_parts_of_each_other(deglint, scene, monkeypatch, one, said):
    monkeypatch.chdir(scene)
    before = contents(scene)
    ran = deglint("remove", "src.tif", "o.tif", *RUN, "--flags", one)
    assert ran.code == 1
    assert said in ran.err
    assert contents(scene) == before


def test_companions_that_are_read_stay(deglint, scene, monkeypatch):
    """An image that is replaced takes its old companions with it: here one is the mask."""
    monkeypatch.chdir(scene)
    shutil.copy("m.tif", "out.tif.msk")
    shutil.copy("src.tif", "out.tif")
    before = contents(scene)
    ran = deglint("remove", "src.tif", "out.tif", "--mask", "out.tif.msk", "--overwrite")
    assert "out.tif.msk is --mask" in ran.err
    assert contents(scene) == before


@pytest.mark.parametrize("output", ["scores.tif", "truth.tif", "m.tif", "link2.tif"])
@pytest.mark.parametrize("beside", ["", ".json"])
def test_a_report_never_replaces_what_is_judged(rxdetect, scene, write, monkeypatch, output, beside):
    monkeypatch.chdir(scene)
    rng = np.random.default_rng(1)
    write("scores.tif", rng.random((1, 80, 100)).astype("f4"), names=None)
    truth = np.zeros((1, 80, 100), np.uint8)
    truth[0, 10:14, 10:14] = 1
    write("truth.tif", truth, names=None)
    Path("link2.tif").symlink_to("scores.tif")
    if beside:  # the JSON beside the report is the file
        os.link(output, "r.html.json")
        output = "r.html"
    before = contents(scene)
    ran = rxdetect("roc", "scores.tif", "truth.tif", "--mask", "m.tif", "--report", output, "--overwrite")
    assert ran.code == 1
    assert "would be lost" in ran.err
    assert contents(scene) == before


@pytest.mark.parametrize(
    "arguments",
    [("v.vrt", "src.tif"), ("src.tif", "o.tif", "--mask", "m.tif", "--flags", "m.tif"),
     ("src.tif", "o.tif", "--background", "s.geojson", "--pfa", "0.01", "--objects", "s.geojson"),
     ("src.tif", "o.tif", "--p-value", "link.tif")],
)  # fmt: skip
def test_scores_never_replace_what_is_read(rxdetect, scene, monkeypatch, arguments):
    monkeypatch.chdir(scene)
    before = contents(scene)
    ran = rxdetect("score", *arguments, "--overwrite")
    assert ran.code == 1
    assert "would be lost" in ran.err
    assert contents(scene) == before


def test_a_plan_never_replaces_its_mission(deglint, scene, monkeypatch):
    monkeypatch.chdir(scene)
    Path("m.json").write_text("[sun]\nzenith = 30\nazimuth = 90\n")
    ran = deglint("plan", "--mission", "m.json", "-o", "m.json", "--overwrite")
    assert "is the mission" in ran.err
    ran = deglint("plan", "--sun", "30@90", "-o", "p.json", "-o", "./p.json")
    assert "two outputs have the same name" in ran.err


@pytest.mark.parametrize("given", ["v.vrt", "list.csv"])
def test_a_batch_never_replaces_what_a_scene_reads(deglint, scene, monkeypatch, given):
    monkeypatch.chdir(scene)
    Path("list.csv").write_text("path,name\nv.vrt,src\n")
    Path("r.toml").write_text(
        '[output]\ndirectory = "."\nname = "{name}.tif"\n[recipe]\nsample = "all"\nmask = "none"\n'
    )
    mosaic(scene / "src.vrt", "src.tif")
    before = contents(scene)
    ran = deglint("batch", "r.toml", "src.vrt" if given == "v.vrt" else given, "--overwrite", "-q")
    assert ran.code == 1
    assert "src.tif is read with a scene" in ran.err
    assert contents(scene) == before


def test_a_table_never_replaces_a_list(deglint, scene, monkeypatch):
    monkeypatch.chdir(scene)
    Path("list.csv").write_text(
        "name,inputs,output,status,reason,seconds,method,corrected,warnings,path\na,,,,,,,,,src.tif\n"
    )
    Path("r.toml").write_text("")
    assert "list.csv is an input" in deglint("batch", "r.toml", "list.csv", "--table", "list.csv").err


def test_files_behind_a_name(sea, write, scene, monkeypatch):
    monkeypatch.chdir(scene)
    assert files_behind(["src.tif", "auto", "0,0,10,10"]) == ("src.tif", "auto", "0,0,10,10")
    assert {Path(f).name for f in files_behind(["deep.vrt"])} == {"deep.vrt", "v.vrt", "src.tif"}
    write("e.img", sea(), driver="ENVI")
    assert {Path(f).name for f in files_behind(["e.img"])} >= {"e.img", "e.hdr"}
    with rasterio.open("src.tif", "r+") as dataset, rasterio.Env(GDAL_TIFF_INTERNAL_MASK=False):
        dataset.write_mask(np.full((80, 100), 255, np.uint8))
    assert {Path(f).name for f in files_behind(["src.tif"])} == {"src.tif", "src.tif.msk"}
    shutil.make_archive("z", "zip", ".", "src.tif")
    assert "z.zip" in {Path(f).name for f in files_behind([f"/vsizip/{scene}/z.zip/src.tif"])}
    check_targets([Path("new.tif")], {"the input": ["deep.vrt"]})
    with pytest.raises(InputError, match="is read with the input"):
        check_targets([Path("z.zip")], {"the input": [f"zip://{scene}/z.zip!src.tif"]}, overwrite=True)


@pytest.fixture
def finished(deglint, sea, write, scene, monkeypatch):
    """A batch of an ENVI file, a VRT over a TIFF, and a TIFF with a mask beside it: all done."""
    monkeypatch.chdir(scene)
    write("e.img", sea(), driver="ENVI")
    write("k.tif", sea())
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=False), rasterio.open("k.tif", "r+") as dataset:
        dataset.write_mask(np.full((80, 100), 255, np.uint8))
    Path("r.toml").write_text(
        '[output]\ndirectory = "o"\n[recipe]\nmethod="hedley"\nsample="all"\nmask="none"\nnir="4"\n'
    )
    ran = deglint("batch", "r.toml", "deep.vrt", "e.img", "k.tif", "-q")
    assert ran.code == 0, ran.out
    config = read_config("r.toml")

    def states():
        return [state_of(job) for job in jobs_of(config, list_scenes(["deep.vrt", "e.img", "k.tif"]))]

    assert [s for s, _ in states()] == ["finished before"] * 3
    return states


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "scene_number"), [("src.tif", 0), ("v.vrt", 0), ("e.hdr", 1), ("e.img", 1), ("k.tif.msk", 2), ("k.tif", 2)]
)
def test_a_batch_notices_a_change_of_any_file_behind_a_scene(finished, file, scene_number):
    data = Path(file).read_bytes()
    Path(file).write_bytes(data.replace(b"80", b"79", 1) if file in ("e.hdr", "v.vrt") else data[:-1] + b"\x07")
    found = finished()[scene_number]
    assert found[0] == "failed"
    assert "scene was changed" in found[1]


def test_a_mask_that_comes_or_goes_is_another_state(finished):
    Path("k.tif.msk").unlink()
    shutil.copy("m.tif", "src.tif.msk")
    assert [s for s, _ in finished()] == ["failed", "finished before", "failed"]


def test_fingerprints_are_known_again(scene, monkeypatch):
    monkeypatch.chdir(scene)
    said = {f["path"]: f for f in Checksum(["deep.vrt"]).fingerprints()}
    assert are_as(["deep.vrt"], json.loads(json.dumps(said)))
    os.utime("src.tif")
    assert are_as(["deep.vrt"], said)
    assert not are_as(["v.vrt"], said)


@pytest.mark.parametrize("how", ["rewritten", "time set back", "replaced", "gone"])
@pytest.mark.parametrize("file", ["src.tif", "v.vrt"])
def test_a_source_that_changes_under_way_is_noticed(deglint, scene, monkeypatch, how, file):
    from deglint.pipeline import correct

    monkeypatch.chdir(scene)
    whole, stamp = correct.Correction.__call__, Path(file).stat()

    def and_then(self, tile):
        data = bytearray(Path(file).read_bytes())
        data[-1] ^= 1
        if how == "gone":
            Path(file).unlink(missing_ok=True)
        elif how == "replaced":
            Path("new").write_bytes(data)
            Path("new").replace(file)
        else:
            Path(file).write_bytes(data)
            if how == "time set back":
                os.utime(file, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
        return whole(self, tile)

    monkeypatch.setattr(correct.Correction, "__call__", and_then)
    ran = deglint("remove", "deep.vrt", "out.tif", *RUN, "-q")
    assert ran.code == 1
    assert f"{file} was changed while" in ran.err
    assert not Path("out.tif").exists()


def test_a_mask_or_score_that_changes_under_way_is_noticed(deglint, rxdetect, scene, write, monkeypatch):
    monkeypatch.chdir(scene)
    from deglint.pipeline import correct

    evaluating = importlib.import_module("detect.report.evaluate")

    def changing(file, whole):
        def call(*arguments, **options):
            os.utime(file, ns=(1, 1))
            return whole(*arguments, **options)

        return call

    monkeypatch.setattr(correct.Correction, "__call__", changing("m.tif", correct.Correction.__call__))
    assert "m.tif was changed while it was read" in deglint("remove", "src.tif", "o.tif", *RUN[:-1], "m.tif").err
    write("t.tif", np.eye(80, 100, dtype=np.uint8)[None], names=None)
    monkeypatch.setattr(evaluating, "read_inputs", changing("src.tif", evaluating.read_inputs))
    ran = rxdetect("roc", "src.tif", "t.tif", "--report", "r.html", "--bootstrap", "0")
    assert ran.code == 1
    assert "src.tif was changed while it was read" in ran.err
    assert not {"o.tif", "r.html"} & {p.name for p in scene.iterdir()}


@pytest.mark.parametrize("how", ["truncated", "written anew"])
def test_an_input_that_changes_under_way(sea, write, tmp_path, how):
    source = Path(write(tmp_path / "in.tif", sea(1100, 1100), tiled=True, blockxsize=64, blockysize=64))
    data = source.read_bytes()
    (tmp_path / "out.tif").write_bytes(b"old")

    def progress(stage, done, total):
        if how == "truncated":
            with source.open("r+b") as file:
                file.truncate(len(data) // 3)
        else:
            source.write_bytes(data[::-1])
            source.write_bytes(data)

    with pytest.raises(ReadError, match=r"truncated or damaged|changed while"):
        remove_glint(source, tmp_path / "out.tif", HEDLEY, overwrite=True, threads=1, progress=progress)
    assert (tmp_path / "out.tif").read_bytes() == b"old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.tif", "out.tif"]


@pytest.mark.parametrize("before", ["", "./", "/vsizip/"])
def test_a_name_that_is_too_long_for_a_file_has_no_files_behind(before):
    name = before + 300 * "x"
    assert files_behind([name]) == (name,)
