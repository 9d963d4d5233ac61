"""What needs nothing is copied: its pixels as they are."""

import json
from pathlib import Path

import numpy as np
import pytest
import rasterio
import rasterio.shutil

from deglint import Recipe, remove_glint
from deglint.pipeline import correct

from .common import WATER

CALM = Recipe(compensate="off", mask="none")


@pytest.fixture
def calm(sea, write, tmp_path):
    """Even water with noise, and no glint; a tiled file."""

    def make(dtype="uint16", hole=True, **options):
        rng = np.random.default_rng(3)
        raw = WATER + rng.normal(0, 5, (4, 320, 300))
        if hole:
            raw[:, :40, :50] = 0
        path = tmp_path / "in.tif"
        write(tmp_path / "plain.tif", raw.astype(dtype), nodata=0)
        layout = {"tiled": True, "blockxsize": 128, "blockysize": 128, "interleave": "pixel"} | options
        rasterio.shutil.copy(str(tmp_path / "plain.tif"), str(path), driver="GTiff", **layout)
        return path

    return make


def same_pixels(a, b):
    with rasterio.open(a) as one, rasterio.open(b) as other:
        return np.array_equal(one.read(), other.read()) and one.profile["dtype"] == other.profile["dtype"]


@pytest.mark.parametrize(
    "options", [{}, {"compress": "deflate", "predictor": 2}, {"interleave": "band"}, {"BIGTIFF": "YES"}]
)
def test_pixels_are_copied(calm, tmp_path, options):
    source, out = calm(**options), tmp_path / "out.tif"
    result = remove_glint(source, out, CALM)
    assert same_pixels(source, out)
    assert result.counts.corrected == 0
    said = json.loads(Path(f"{out}.json").read_text())
    assert said["pixels"]["total"] == 320 * 300
    assert said["pixels"]["nodata"] == 2000
    assert any("Nothing was corrected" in w for w in said["warnings"])


def test_log_and_picture_say_that_nothing_was_corrected(calm, tmp_path, caplog, monkeypatch):
    titles = []
    monkeypatch.setattr("cv2.putText", lambda _image, title, *_: titles.append(title))
    with caplog.at_level("INFO", "deglint"):
        remove_glint(calm(), tmp_path / "out.tif", CALM, picture=tmp_path / "p.png")
    assert titles == ["before (red, green, blue)", "copied"]
    assert "method: none, the scene is copied" in caplog.messages


def test_amount_and_flags_are_zero_where_nothing_is_corrected(calm, read, tmp_path):
    source = calm()
    result = remove_glint(source, tmp_path / "out.tif", CALM, amount=tmp_path / "a.tif", flags=tmp_path / "f.tif")
    assert result.counts.corrected == 0
    amount, flags = read(tmp_path / "a.tif"), read(tmp_path / "f.tif")[0]
    hole = np.zeros((320, 300), bool)
    hole[:40, :50] = True
    assert amount.shape == (4, 320, 300)
    np.testing.assert_array_equal(amount[:, ~hole], 0)
    assert np.isnan(amount[:, hole]).all()
    np.testing.assert_array_equal(flags, np.where(hole, 1, 0))
    assert same_pixels(source, tmp_path / "out.tif")
    remove_glint(source, tmp_path / "o2.tif", CALM, amount=tmp_path / "a2.tif")
    np.testing.assert_array_equal(read(tmp_path / "a2.tif"), amount)


def test_another_type_is_written_anew(calm, tmp_path):
    result = remove_glint(calm(dtype="int16"), tmp_path / "out.tif", CALM, dtype="float64")
    assert result.sidecar["pixels"]["nodata"] == 2000
    with rasterio.open(tmp_path / "out.tif") as out, rasterio.open(tmp_path / "in.tif") as source:
        assert out.dtypes[0] == "float64"
        np.testing.assert_array_equal(out.read(), source.read())


def test_flags_are_of_every_pixel(calm, tmp_path):
    result = remove_glint(calm(), tmp_path / "out.tif", CALM, flags=tmp_path / "flags.tif")
    assert result.sidecar["pixels"]["nodata"] == 2000
    assert same_pixels(tmp_path / "in.tif", tmp_path / "out.tif")


def test_a_truncated_file_is_not_copied(calm, deglint, tmp_path):
    source = calm(compress="deflate")
    data = source.read_bytes()
    source.write_bytes(data[:-300])
    ran = deglint("remove", source, tmp_path / "out.tif", "--compensate", "off", "--sample", "100,100,120,120",
                  "--mask", "none")  # fmt: skip
    assert ran.code == 1
    assert "truncated or damaged" in ran.err
    assert not (tmp_path / "out.tif").exists()


def test_a_tile_without_a_valid_pixel_skips_the_chain(write, read, tmp_path, monkeypatch):
    rng = np.random.default_rng(2)
    raw = rng.normal(WATER, 5, (4, 512, 2048)).astype(np.float32)
    for band in raw:
        band[rng.random(band.shape) < 0.02] += 300
    raw[:, :, :1200] = np.nan
    source = write(tmp_path / "in.tif", raw, tiled=True, blockxsize=256, blockysize=256)
    done = []
    inner = correct.apply_chain
    monkeypatch.setattr(correct, "apply_chain", lambda state, *a: done.append(state.origin[1]) or inner(state, *a))
    stages = "identify-level:13, replace-level, remove"
    recipe = Recipe(compensate=stages, method="joyce", sample="1300,0,700,512", mask="none")
    result = remove_glint(source, tmp_path / "out.tif", recipe)
    assert done
    assert 512 < min(done) <= 1024  # the cell that holds column 1200, with its halo
    out = read(tmp_path / "out.tif")
    assert np.isnan(out[:, :, :1200]).all()
    assert (out[:, :, 1200:] != raw[:, :, 1200:]).any()
    assert result.counts.nodata == 512 * 1200


def test_a_scene_that_is_copied_has_an_empty_sample(write, tmp_path):
    even = np.random.default_rng(0).normal(500, 3, (4, 160, 160)).astype(np.uint16)
    sample = tmp_path / "s.geojson"
    result = remove_glint(write(tmp_path / "a.tif", even), tmp_path / "o.tif", Recipe(mask="none"), sample=sample)
    assert not result.fitted.model.fits
    assert json.loads(sample.read_text())["features"] == []
