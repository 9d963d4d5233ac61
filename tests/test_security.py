"""Hostile and broken input: an error in one line, bounded memory and time; names never lead out of a directory."""

import json
import re
import struct
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from deglint.batch import read_config
from deglint.errors import InputError
from deglint.raster.info import open_dataset
from deglint.readers.scenes import checked_name, list_scenes

from .common import ROOT, RUN, says, write_vrt


def sparse(path, side, **options):
    """A GeoTIFF that declares much and holds nothing."""
    import rasterio

    profile = {"driver": "GTiff", "dtype": "uint8", "count": 2, "height": side, "width": side, "SPARSE_OK": True,
               "tiled": True, "blockxsize": 512, "blockysize": 512, "BIGTIFF": "YES"}  # fmt: skip
    with rasterio.open(path, "w", **{k: v for k, v in (profile | options).items() if v is not None}):
        pass
    return str(path)


def vrt(path, rows, columns, source="none.tif"):
    """A mosaic of four bands that declares a size."""
    return write_vrt(path, rows, columns, source, bands=(1, 1, 1, 1), dtype="Byte")


@pytest.mark.slow
def test_mutants_are_refused_or_worked_on(tmp_path, monkeypatch, record_property):
    """A short turn of `python -m tests.fuzz`: nothing crashes, hangs, fills the memory or leaves half a file."""
    monkeypatch.syspath_prepend(str(ROOT / "tests"))
    import fuzz

    tried = fuzz.fuzz(tmp_path, cases=150)
    record_property("tried", tried.inputs)
    assert not tried.findings
    assert tried.done + tried.refused == tried.inputs


def test_the_same_number_is_the_same_mutant(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "tests"))
    import fuzz

    (tmp_path / "s").mkdir()
    found = fuzz.samples(tmp_path / "s")
    one, two = tmp_path / "1", tmp_path / "2"
    for place in (one, two):
        place.mkdir()
        for number in range(8):
            fuzz.case(number, 3, found, place)
    assert {p.name: p.read_bytes() for p in one.iterdir()} == {p.name: p.read_bytes() for p in two.iterdir()}


def test_absurd_sizes_are_refused_at_once(deglint, tmp_path):
    for path in (
        vrt(tmp_path / "a.vrt", 2_000_000_000, 2_000_000_000),
        sparse(tmp_path / "a.tif", 2_000_000, blockxsize=16_384, blockysize=16_384),
    ):
        ran = deglint("remove", path, tmp_path / "out.tif", *RUN)
        assert ran.code == 1
        assert re.match(r"Error: \S+ declares \d+ x \d+ pixels; allowed are 1,099,511,627,776", ran.err)
        assert "DEGLINT_MAX_PIXELS" in ran.err


def test_mosaics_of_100_gigabytes_pass(tmp_path):
    with open_dataset(vrt(tmp_path / "a.vrt", 320_000, 320_000)) as dataset:
        assert dataset.width * dataset.height > 100e9
    with open_dataset(sparse(tmp_path / "a.tif", 350_000)) as dataset:
        assert dataset.count == 2


def test_blocks_that_do_not_fit_the_memory_are_refused(deglint, tmp_path, monkeypatch):
    large = sparse(tmp_path / "a.tif", 33_000, blockysize=32_768, blockxsize=32_768, compress="deflate")
    said = deglint("info", large).err
    assert says(said, "32768 x 32768 pixels", "2048 MB", "1024 MB")
    assert "TILED=YES" in said
    monkeypatch.setenv("DEGLINT_MAX_BLOCK_MB", "3000")
    open_dataset(large).close()


def test_the_limits_are_settable(deglint, sea, write, tmp_path, monkeypatch):
    source = write(tmp_path / "in.tif", sea())
    monkeypatch.setenv("DEGLINT_MAX_PIXELS", "7999")
    assert says(deglint("info", source).err, "100 x 80 pixels", "7,999")
    monkeypatch.setenv("DEGLINT_MAX_PIXELS", "8e3")
    assert deglint("info", source).code == 0
    monkeypatch.setenv("DEGLINT_MAX_PIXELS", "many")
    assert "DEGLINT_MAX_PIXELS is 'many'" in deglint("info", source).err
    monkeypatch.delenv("DEGLINT_MAX_PIXELS")
    monkeypatch.setenv("DEGLINT_MAX_BLOCK_MB", "0")
    assert "DEGLINT_MAX_BLOCK_MB is '0'" in deglint("info", source).err


def test_a_mosaic_that_holds_itself_ends(deglint, tmp_path):
    ran = deglint("remove", vrt(tmp_path / "a.vrt", 500, 500, source="a.vrt"), tmp_path / "o.tif", *RUN, "--nir", "4")
    assert ran.code == 1
    assert ran.err.count("\n") == 1


def deep(path, directories, *, loop=False):
    """A TIFF of 64 x 64 pixels and so many reduced images, the last of which may lead to the first again."""
    size = 2 + 12 * 10 + 4
    out = bytearray(b"II*\0" + struct.pack("<I", 8))
    for i in range(directories):
        side, last = (32 if i else 64), i + 1 == directories
        tags = ((254, 4, bool(i)), (256, 4, side), (257, 4, side), (258, 3, 8), (259, 3, 1), (262, 3, 1), (273, 4, 8),
                (277, 3, 1), (278, 4, side), (279, 4, side**2))  # fmt: skip
        out += struct.pack("<H", 10) + b"".join(struct.pack("<HHII", tag, kind, 1, n) for tag, kind, n in tags)
        out += struct.pack("<I", 8 + size * (i + 1) if not last else 8 * loop)
    path.write_bytes(out + bytes(64 * 64))
    return path


@pytest.mark.parametrize(("directories", "loop"), [(5_000, False), (3, True)], ids=["many", "in a circle"])
def test_deep_overviews_do_no_harm(deglint, tmp_path, directories, loop):
    """GDAL stops by itself; the scene is read all the same."""
    ran = deglint("info", deep(tmp_path / "a.tif", directories, loop=loop))
    assert ran.code == 0, ran.err
    assert "64 x 64 pixels" in ran.out


LITTLE = """
    import sys
    from deglint.cli import run
    code = run(sys.argv[1:])
    lines = open("/proc/self/status").read().splitlines()  # ru_maxrss would count what the parent held
    print(next(int(line.split()[1]) // 1024 for line in lines if line.startswith("VmHWM")))
    sys.exit(code)
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="this system does not tell a process's peak")
def test_a_large_scene_without_water_is_looked_through_in_bounded_memory(tmp_path):
    """The last look is at everything; what is held of it must not grow with the scene."""
    source = sparse(tmp_path / "a.tif", 12_000, count=4)  # 0 everywhere: valid, and no water
    call = [
        sys.executable,
        "-c",
        textwrap.dedent(LITTLE),
        "remove",
        source,
        str(tmp_path / "o.tif"),
        "--nir",
        "4",
        "-q",
    ]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert done.returncode in (1, 3), done.stderr
    assert int(done.stdout) < 1000


@pytest.mark.parametrize("name", ["../up", "a/b", "..", ".hidden", "a\\b", "a\nb", "\x00", "", "x" * 151])
def test_names_in_lists_cannot_leave_the_directory(tmp_path, name):
    with pytest.raises(InputError, match="no file name can be made"):
        checked_name(name, "list")
    item = {"type": "Feature", "id": name, "assets": {"data": {"href": "a.tif"}}}
    (tmp_path / "s.json").write_text(json.dumps(item))
    with pytest.raises(InputError, match="no file name can be made"):
        list_scenes([str(tmp_path / "s.json")])


def test_lists_and_recipes_that_are_nested_too_deep_are_one_line(tmp_path):
    (tmp_path / "r.toml").write_text("a = " + "[" * 100_000)
    with pytest.raises(InputError, match="is not TOML"):
        read_config(str(tmp_path / "r.toml"))
    (tmp_path / "s.json").write_text("[" * 100_000)
    with pytest.raises(InputError, match="is not JSON"):
        list_scenes([str(tmp_path / "s.json")])


@pytest.mark.parametrize("text", ["a = " + "1" * 5000, "a = " + "[" * 100_000, "[" * 3])
def test_a_mission_that_is_no_toml_is_one_line(deglint, tmp_path, text):
    (tmp_path / "m.toml").write_text(text)
    ran = deglint("plan", "--mission", tmp_path / "m.toml", "-o", tmp_path / "o.json")
    assert ran.code == 1
    assert "is not TOML" in ran.err
    assert ran.err.count("\n") == 1


def test_a_recipe_leads_nowhere_above(deglint, sea, write, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    write("in.tif", sea())
    for directory in ("../..", "..", "a/../../b", "./../x"):
        recipe = f'[output]\ndirectory = "{directory}"\n[recipe]\nmethod = "hedley"\nmask = "none"\n'
        Path("r.toml").write_text(recipe)
        ran = deglint("batch", "r.toml", "in.tif")
        assert ran.code == 1, directory
        assert "outside the current directory" in ran.err
        assert "--directory DIR" in ran.err
        assert [p.name for p in tmp_path.iterdir()] == ["here"]
    assert deglint("batch", "r.toml", "in.tif", "--directory", tmp_path / "there").code == 0
    assert len(list((tmp_path / "there").iterdir())) == 2


def test_nothing_from_a_disk_is_unpickled():
    """No room loads pickled objects, nor numpy files that may hold them."""
    loads = re.compile(
        r"\b(?:import|from) (?:pickle|marshal|shelve|joblib|dill)\b|\b(?:np|numpy)\.load\(|\beval\(|\bexec\("
    )
    for room in ("deglint", "detect"):
        for path in (ROOT / room).rglob("*.py"):
            assert not loads.search(path.read_text()), path


@pytest.mark.skipif(not Path("/sys/kernel").exists(), reason="this system has no directory that nobody may write to")
def test_a_directory_that_nobody_may_write_to(deglint, sea, write, tmp_path):
    ran = deglint("remove", write(tmp_path / "in.tif", sea()), "/sys/kernel/out.tif", *RUN)
    assert ran.code == 1
    assert ran.err.startswith("Error: ")
    assert ran.err.count("\n") == 1
    assert "/sys/kernel" in ran.err


FEW_FILES = """
    import resource, sys
    from deglint.cli import run
    import deglint.pipeline, rasterio, cv2, scipy.ndimage
    limit = len(__import__("os").listdir("/proc/self/fd")) + int(sys.argv[1])
    resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit))
    sys.exit(run(sys.argv[2:]))
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="this system does not list open files")
@pytest.mark.parametrize("spare", [1, 5])
def test_a_limit_on_open_files(sea, write, tmp_path, spare):
    sources = [write(tmp_path / f"{i}.tif", sea()[[i]], names=[name]) for i, name in
               enumerate(("blue", "green", "red", "nir"))]  # fmt: skip
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "out.tif").write_bytes(b"old")
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(FEW_FILES), str(spare), "remove", *sources,
         str(tmp_path / "out" / "out.tif"), *RUN, "--overwrite", "-q", "--threads", "8"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.startswith("Error: ")
    assert done.stderr.count("\n") == 1
    assert "open files" in done.stderr
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["out.tif"]
    assert (tmp_path / "out" / "out.tif").read_bytes() == b"old"
