"""What goes wrong: one line that says what to do, the right exit code, the old output as it was, and no scratch."""

import gzip
import json
import re
import signal
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import deglint as library
from deglint import Recipe, remove_glint
from deglint.errors import InputError, ReadError, WriteError
from deglint.remove.strips import Strips

from .common import HEDLEY, RUN, says, write_vrt


@pytest.fixture
def refused(deglint, tmp_path):
    """Run `deglint remove` onto an old output: it must fail with one line and leave everything as it was."""
    out = tmp_path / "out"
    out.mkdir()
    (out / "out.tif").write_bytes(b"old")

    def call(source, *arguments, code=1):
        ran = deglint("remove", source, out / "out.tif", "--overwrite", *arguments)
        assert ran.code == code, ran.err
        assert ran.out == ""
        assert ran.err.startswith("Error: ")
        assert ran.err.count("\n") == 1
        assert "Traceback" not in ran.err
        assert [p.name for p in out.iterdir()] == ["out.tif"]
        assert (out / "out.tif").read_bytes() == b"old"
        return ran.err

    return call


def test_no_such_file(refused, tmp_path):
    assert "no such file" in refused(tmp_path / "none.tif")
    assert "no such file" in refused("/vsizip/none.zip/none.tif")


def test_not_a_raster(refused, tmp_path):
    (tmp_path / "a.tif").write_text("I am a text")
    assert "not a raster" in refused(tmp_path / "a.tif")
    (tmp_path / "b.tif").write_bytes(b"")
    assert "not a raster" in refused(tmp_path / "b.tif")
    assert "not a raster" in refused(tmp_path)


@pytest.mark.parametrize("part", [0.001, 0.02, 0.3, 0.6, 0.9, 0.999])
@pytest.mark.parametrize(
    "layout",
    [{}, {"compress": "deflate"}, {"tiled": True, "blockxsize": 64, "blockysize": 64, "compress": "lzw"},
     {"interleave": "pixel"}, {"tiled": True, "blockxsize": 64, "blockysize": 64}],
    ids=["strips", "deflate", "lzw tiles", "pixel", "tiles"],
)  # fmt: skip
def test_a_truncated_file(refused, sea, write, tmp_path, layout, part):
    path = Path(write(tmp_path / "in.tif", sea(200, 150), **layout))
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * part)])
    said = refused(path, *RUN, "--nir", "4")
    assert "truncated or damaged" in said or "not a raster" in said


def test_a_virtual_raster_whose_file_is_missing(refused, tmp_path):
    path = write_vrt(tmp_path / "in.vrt", 200, 150, "gone.tif", bands=(1,))
    said = refused(path, *RUN, "--bands", "nir", "--mask", "none", "--sample", "all")
    assert "gone.tif" in said
    assert "is missing" in said
    assert "damaged" not in said


def test_a_truncated_envi_file(refused, sea, write, tmp_path):
    path = Path(write(tmp_path / "in.img", sea(200, 150), driver="ENVI"))
    path.write_bytes(path.read_bytes()[:-100])
    assert "truncated or damaged" in refused(path, *RUN)


def test_an_envi_file_that_lacks_what_its_offset_skips(refused, sea, write, tmp_path):
    path = Path(write(tmp_path / "in.img", sea(200, 150), driver="ENVI"))
    header = path.with_suffix(".hdr")
    header.write_text(header.read_text().replace("header offset = 0", "header offset = 100"))
    Path(f"{path}.aux.xml").unlink()  # it holds the former header
    assert "truncated or damaged" in refused(path, *RUN)
    path.write_bytes(bytes(100) + path.read_bytes())
    np.testing.assert_array_equal(library.open_scene(path).read(), sea(200, 150))


def test_an_envi_offset_that_is_no_number_is_0_as_in_gdal(sea, write, tmp_path):
    path = Path(write(tmp_path / "in.img", sea(), driver="ENVI"))
    header = path.with_suffix(".hdr")
    header.write_text(header.read_text().replace("header offset = 0", "header offset = none"))
    Path(f"{path}.aux.xml").unlink()
    np.testing.assert_array_equal(library.open_scene(path).read(), sea())


def test_a_compressed_envi_file_is_not_called_truncated(sea, write, tmp_path):
    path = Path(write(tmp_path / "in.img", sea(), driver="ENVI"))
    path.write_bytes(gzip.compress(path.read_bytes()))
    header = path.with_suffix(".hdr")
    header.write_text(header.read_text().rstrip() + "\nfile compression = 1\n")
    np.testing.assert_array_equal(library.open_scene(path).read(), sea())


def test_damage_in_the_middle_of_a_compressed_file(refused, sea, write, tmp_path):
    path = Path(write(tmp_path / "in.tif", sea(200, 150), compress="deflate"))
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 500] = b"\xaa" * 500
    path.write_bytes(data)
    assert "truncated or damaged" in refused(path, *RUN)


def test_one_band(refused, sea, write, tmp_path):
    for names in (["blue"], None):
        said = refused(write(tmp_path / "in.tif", sea()[:1], names=names))
        assert "no near-infrared band" in said
        assert "stack a NIR band" in said
    said = refused(write(tmp_path / "b.tif", sea()[3:], names=["nir"]))
    assert says(said, "only the NIR", "(-b)", "stack visible")


def test_no_nir_lists_the_bands_and_the_option(refused, sea, write, tmp_path):
    said = refused(write(tmp_path / "in.tif", sea(), names=["a", "b", "c", "d"]))
    assert "1 a, 2 b, 3 c, 4 d" in said
    assert "--bands" in said


def test_a_constant_nir(refused, sea, write, tmp_path):
    raw = sea()
    raw[3] = 77
    assert "nir is constant (77)" in refused(write(tmp_path / "in.tif", raw), *RUN)


def test_an_empty_sample(refused, sea, write, geojson, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    small = [(400_012, 799_982), (400_013, 799_982), (400_013, 799_981)]  # between centres
    path = geojson(tmp_path / "small.geojson", small, crs="EPSG:32653")
    assert "selects no pixel of the scene" in refused(source, "--sample", path, code=1)
    assert "sample has 25 valid pixels" in refused(source, "--sample", "0,0,5,5", "--method", "hedley")


def test_a_sample_off_the_image(refused, sea, write, geojson, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    path = geojson(tmp_path / "far.geojson", [(10, 50), (11, 50), (11, 51)])
    assert "--sample" in refused(source, "--sample", path)
    assert "lies off the scene" in refused(source, "--sample", "500,500,10,10")


def test_all_nodata_is_3(refused, write, tmp_path):
    source = write(tmp_path / "in.tif", np.full((4, 60, 60), 9, np.uint16), nodata=9)
    refused(source, code=3)
    refused(source, "--method", "nir-subtraction", "--mask", "none", code=3)
    refused(write(tmp_path / "b.tif", np.full((4, 60, 60), np.nan, np.float32)), code=3)


def test_all_land_is_3(refused, write, tmp_path):
    rng = np.random.default_rng(0)
    land = np.array([300.0, 500, 600, 3000])[:, None, None] * rng.normal(1, 0.1, (4, 100, 100))
    said = refused(write(tmp_path / "in.tif", land.astype(np.uint16)), code=3)
    assert "no water" in said


def test_nothing_inside_the_mask_is_3(refused, sea, write, tmp_path):
    mask = write(tmp_path / "m.tif", np.zeros((1, 80, 100), np.uint8), names=None)
    assert f"--mask {mask} selects no pixel of the scene" in refused(
        write(tmp_path / "in.tif", sea()), "--method", "hedley", "--sample", "all", "--mask", mask, code=3
    )


def test_no_valid_pixel_inside_the_mask_is_3(refused, sea, write, tmp_path):
    raw = sea()
    raw[:, :20, :20] = 0
    source = write(tmp_path / "in.tif", raw, nodata=0)
    said = refused(source, "--method", "hedley", "--sample", "all", "--mask", "0,0,20,20", code=3)
    assert "nothing to correct in" in said
    assert "no pixel is water inside the mask" in said


def test_a_saved_model_that_does_not_fit(refused, sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    for text in ("", "{", "[]", "{}", '{"method": "hedley"}', "null", '{"fits": 3, "indexes": 4}'):
        (tmp_path / "m.json").write_text(text)
        assert "not a saved deglint model" in refused(source, "--model", tmp_path / "m.json")
    model = library.fit("hedley", sea(dtype="float32"), nir=3)
    for nothing in ([], [{"bands": [], "weights": [], "level": 0}]):
        text = json.dumps(json.loads(model.to_json()) | {"indexes": nothing})
        (tmp_path / "m.json").write_text(text)
        assert "not a saved deglint model" in refused(source, "--model", tmp_path / "m.json")
    (tmp_path / "m.json").write_text(model.to_json())
    assert "band 1" in refused(source, "--model", tmp_path / "m.json")
    for rows in (("0", "1"), ("01",)):  # this scene is two squares high and wide
        strips = replace(model, band_names=("blue", "green", "red", "nir"), strips=Strips(rows), second=model.indexes)
        (tmp_path / "m.json").write_text(strips.to_json())
        assert "the detector strips of another scene" in refused(source, "--model", tmp_path / "m.json")


def test_an_output_that_exists(deglint, sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    for name in ("out.tif", "out.tif.json", "f.tif", "a.tif", "s.geojson", "m.json", "p.png"):
        (tmp_path / name).write_text("old")
        ran = deglint("remove", source, tmp_path / "out.tif", *RUN, "--flags", tmp_path / "f.tif",
                      "--amount", tmp_path / "a.tif", "--save-sample", tmp_path / "s.geojson",
                      "--save-model", tmp_path / "m.json", "--picture", tmp_path / "p.png")  # fmt: skip
        assert ran.code == 1
        assert f"{name} exists already. Give --overwrite" in ran.err
        assert (tmp_path / name).read_text() == "old"
        (tmp_path / name).unlink()
        assert [p.name for p in tmp_path.iterdir()] == ["in.tif"]


def test_outputs_that_cannot_be_written(deglint, sea, write, tmp_path, monkeypatch):
    source = write(tmp_path / "in.tif", sea())

    def said(name, *more):
        ran = deglint("remove", source, name, *RUN, "--overwrite", *more)
        assert ran.code == 1
        assert ran.err.count("\n") == 1
        return ran.err

    assert "is a directory" in said(tmp_path)
    assert says(said(tmp_path / "in.tif" / "new" / "o.tif"), "in.tif is a file", "another place")
    assert "does not exist. Make it first" in said(tmp_path / "nowhere" / "out.tif")
    assert "outputs are local files" in said("/vsimem/out.tif")
    assert "outputs are local files" in said("s3://bucket/out.tif")
    assert "two outputs have the same name" in said(tmp_path / "o.tif", "--flags", tmp_path / "o.tif")
    assert "two outputs have the same name" in said(tmp_path / "o.tif", "--save-model", tmp_path / "o.tif.json")
    again = tmp_path / "sub" / ".." / "o.tif"
    (tmp_path / "sub").mkdir()
    assert "two outputs have the same name" in said(tmp_path / "o.tif", "--amount", again)
    assert "is not a regular file" in said(tmp_path / "o.tif", "--flags", "/dev/null")
    monkeypatch.setattr("os.access", lambda *_: False)
    assert "no permission to write" in said(tmp_path / "o.tif")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.tif", "sub"]


def test_a_disk_that_is_too_small_is_known_before_the_work(refused, sea, write, tmp_path, monkeypatch):
    class Full:
        free = 10_240

    source = write(tmp_path / "in.tif", sea(300, 300))
    monkeypatch.setattr("shutil.disk_usage", lambda _: Full)
    said = refused(source, *RUN)
    assert "MB left" in said
    assert "--co COMPRESS" in said


LIMITED = """
    import resource, signal, sys
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1])))
    from deglint.cli import run
    sys.exit(run(sys.argv[2:]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("limit", [100, 50_000, 1_000_000])
@pytest.mark.parametrize("co", ["COMPRESS=NONE", "COMPRESS=DEFLATE"])
def test_a_disk_that_fills_up(sea, write, tmp_path, co, limit):
    source = write(tmp_path / "in.tif", sea(700, 700))
    (tmp_path / "out.tif").write_bytes(b"old")
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(LIMITED), str(limit), "remove", source, str(tmp_path / "out.tif"),
         *RUN, "--overwrite", "--co", co, "-q"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.startswith(f"Error: cannot write {tmp_path / 'out.tif'}: ")
    assert "full" in done.stderr
    assert done.stderr.count("\n") == 1
    assert (tmp_path / "out.tif").read_bytes() == b"old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.tif", "out.tif"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_small_file_that_cannot_be_written(sea, write, tmp_path, monkeypatch):
    source = write(tmp_path / "in.tif", sea())
    whole = Path.write_bytes

    def fill_up(path, data):
        return whole(Path("/dev/full") if ".json." in path.name else path, data)

    monkeypatch.setattr(Path, "write_bytes", fill_up)
    with pytest.raises(WriteError, match=r"out\.tif\.json.*disk is full"):
        remove_glint(source, tmp_path / "out.tif", HEDLEY)
    assert [p.name for p in tmp_path.iterdir()] == ["in.tif"]


SLOW = """
    import sys, time
    from deglint.raster.output import RasterWriter
    write = RasterWriter.write
    def slowly(self, block, window):
        write(self, block, window)
        print("writing", flush=True)
        time.sleep(30)
    RasterWriter.write = slowly
    from deglint.cli import run
    sys.exit(run(sys.argv[1:]))
"""


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM], ids=["Ctrl-C", "kill"])
def test_an_interruption_leaves_everything_as_it_was(sea, write, tmp_path, how):
    source = write(tmp_path / "in.tif", sea(300, 300))
    (tmp_path / "out.tif").write_bytes(b"old")
    call = [sys.executable, "-c", textwrap.dedent(SLOW), "remove", source, str(tmp_path / "out.tif"), *RUN,
            "--overwrite", "--flags", str(tmp_path / "flags.tif"), "-q"]  # fmt: skip
    with subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        assert running.stdout.readline() == "writing\n"
        assert len(list(tmp_path.iterdir())) == 5  # the flags have names of their values beside them
        running.send_signal(how)
        _, said = running.communicate(timeout=20)
    assert running.returncode == 130
    assert re.fullmatch(r"\ninterrupted: .*no incomplete output.*\n", said)
    assert (tmp_path / "out.tif").read_bytes() == b"old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.tif", "out.tif"]


def test_an_interruption_while_threads_read(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea(300, 300))
    code = """
        import sys
        from deglint.raster import RasterSource
        read = RasterSource.read_raw
        def slowly(self, window):
            print("reading", flush=True)
            sys.stdin.read()  # until it is closed
            return read(self, window)
        RasterSource.read_raw = slowly
        from deglint.cli import run
        sys.exit(run(sys.argv[1:]))
    """
    call = [sys.executable, "-c", textwrap.dedent(code), "remove", source, str(tmp_path / "out.tif"), *RUN]
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen(call, **pipes, text=True) as running:
        assert running.stdout.readline() == "reading\n"
        running.send_signal(signal.SIGINT)
        _, said = running.communicate(timeout=20)
    assert running.returncode == 130
    assert says(said, "interrupted: ", "no incomplete output")
    assert [p.name for p in tmp_path.iterdir()] == ["in.tif"]


@pytest.mark.parametrize("threads", [1, 4])
def test_a_fault_in_a_worker_reaches_the_caller(sea, write, tmp_path, monkeypatch, threads):
    source = write(tmp_path / "in.tif", sea(1100, 1100), tiled=True, blockxsize=64, blockysize=64)
    calls = []

    def fail(self, window):
        calls.append(window)
        raise ReadError("the tape is torn")

    monkeypatch.setattr("deglint.raster.RasterSource.read_raw", fail)
    with pytest.raises(ReadError, match="the tape is torn"):
        remove_glint(source, tmp_path / "out.tif", HEDLEY, threads=threads)
    assert len(calls) <= threads + 1
    assert [p.name for p in tmp_path.iterdir()] == ["in.tif"]


def test_out_of_memory_is_one_line(deglint, sea, write, tmp_path, monkeypatch):
    def fail(self, window):
        raise MemoryError

    monkeypatch.setattr("deglint.raster.RasterSource.read_raw", fail)
    ran = deglint("remove", write(tmp_path / "in.tif", sea()), tmp_path / "out.tif", *RUN, "-q")
    assert ran.code == 1
    assert ran.err.startswith("Error: out of memory. Use fewer --threads")


def test_the_progress_callback_may_stop_the_work(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())

    class StopError(Exception):
        pass

    def progress(stage, done, total):
        if stage == "correct":
            raise StopError

    with pytest.raises(StopError):
        remove_glint(source, tmp_path / "out.tif", HEDLEY, progress=progress)
    assert [p.name for p in tmp_path.iterdir()] == ["in.tif"]


def test_the_errors_of_the_library_are_the_builtins_that_one_guesses(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    with pytest.raises(OSError, match="no such file"):
        remove_glint(tmp_path / "none.tif", tmp_path / "out.tif")
    with pytest.raises(ValueError, match="is not one of"):
        Recipe(method="magic")
    with pytest.raises(ValueError, match="is not one of"):
        remove_glint(source, tmp_path / "out.tif", Recipe(method="hedley", regression="magic", mask="none"))
    with pytest.raises(InputError, match="dtype"):
        remove_glint(source, tmp_path / "out.tif", dtype="complex64")
    with pytest.raises(InputError, match="threads"):
        remove_glint(source, tmp_path / "out.tif", threads=0)
    assert [p.name for p in tmp_path.iterdir()] == ["in.tif"]


def test_a_warning_of_a_library_is_no_line_of_its_own(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea(), crs=None, transform=None)
    done = subprocess.run(
        [sys.executable, "-m", "deglint", "remove", source, str(tmp_path / "out.tif"), *RUN, "-q",
         "--picture", str(tmp_path / "p.png"), "--flags", str(tmp_path / "f.tif")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def _mid_write(sea, write, tmp_path, *more):
    """A run that has written a part of its output, and waits."""
    source = write(tmp_path / "in.tif", sea(300, 300))
    call = [sys.executable, "-c", textwrap.dedent(SLOW), "remove", source, str(tmp_path / "out.tif"), *RUN, "-q", *more]
    running = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert running.stdout.readline() == "writing\n"
    return source, running


def test_kill_9_in_the_middle_of_writing(deglint, sea, write, read, tmp_path):
    """The scratch file stays, since nobody is left to remove it; it is never taken for an output."""
    (tmp_path / "out.tif").write_bytes(b"old")
    source, running = _mid_write(sea, write, tmp_path, "--overwrite")
    running.kill()
    running.communicate(timeout=20)
    assert (tmp_path / "out.tif").read_bytes() == b"old"
    left = {p.name for p in tmp_path.iterdir()} - {"in.tif", "out.tif"}
    assert len(left) == 1
    assert left.pop().startswith(".out.tif.")
    assert deglint("remove", source, tmp_path / "out.tif", *RUN, "--overwrite").code == 0
    assert read(tmp_path / "out.tif").shape == (4, 300, 300)


def test_a_directory_that_turns_read_only(refused, sea, write, tmp_path, monkeypatch):
    def refuse(self, target):
        raise OSError(30, "Read-only file system", str(target))

    source = write(tmp_path / "in.tif", sea())
    monkeypatch.setattr(Path, "replace", refuse)
    assert "Read-only file system" in refused(source, *RUN)
