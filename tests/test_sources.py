"""Rasters that take long to look at, or whose header is not right."""

import json
from pathlib import Path

import pytest

from .common import says, write_vrt


@pytest.mark.slow
def test_a_look_ends_where_its_time_is_over(deglint, sea, write, tmp_path, monkeypatch):
    """Nearly all of it is empty, so that a look for water would read it all."""
    write(tmp_path / "in.tif", sea())
    path = write_vrt(tmp_path / "a.vrt", 1_000_000, 1_000_000, "in.tif")
    monkeypatch.setenv("DEGLINT_INFO_SECONDS", "1")
    ran = deglint("info", path, "--nir", "4", "--json")
    assert ran.code == 0
    assert says(json.loads(ran.out)["reason"], "stopped after 1 s: ", "DEGLINT_INFO_SECONDS")


@pytest.mark.parametrize("size", ["0, 0", "0, 10", "10, 0", "1e-200, 1e-200", "nan, nan"])
def test_pixels_of_no_size_are_one_line(deglint, sea, write, tmp_path, size):
    source = write(tmp_path / "in.tif", sea())
    path = Path(write(tmp_path / "e.img", sea(), driver="ENVI")).with_suffix(".hdr")
    place = f"map info = {{UTM, 1, 1, 400000, 800000, {size}, 53, North, WGS-84}}"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(place if line.startswith("map info") else line for line in lines))
    for arguments in (["info", tmp_path / "e.img"], ["remove", tmp_path / "e.img", tmp_path / "o.tif"],
                      ["remove", source, tmp_path / "o.tif", "--mask", tmp_path / "e.img"]):  # fmt: skip
        ran = deglint(*arguments)
        assert ran.code == 1
        assert "cannot be inverted" in ran.err
        assert ran.err.count("\n") == 1
