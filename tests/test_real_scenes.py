"""Real scenes through the whole pipeline; they lie beside the project, and tests skip where they do not."""

import json

import numpy as np
import pytest
import rasterio
from rasterio.features import geometry_mask

import deglint

from .common import SHARED

SENTINEL2 = SHARED / "sentinel2"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.shared,
    pytest.mark.skipif(not SENTINEL2.exists(), reason="the real scenes are not beside the project"),
]
VISIBLE = ("B02", "B03", "B04")
PUBLISHED = (0.856348, 0.869187, 0.806518)


def values(path, names=VISIBLE):
    with rasterio.open(path) as dataset:
        return dataset.read([dataset.descriptions.index(n) + 1 for n in names])


def deep_water():
    with rasterio.open(SENTINEL2 / "palau.tif") as dataset:
        polygon = json.loads((SENTINEL2 / "palau_deep_water.geojson").read_text())["features"][0]["geometry"]
        return geometry_mask([polygon], dataset.shape, dataset.transform, invert=True)


def test_palau_reproduces_independent_software_through_files(tmp_path):
    recipe = deglint.Recipe(
        method="hedley",
        sample=str(SENTINEL2 / "palau_deep_water.geojson"),
        mask="none",
        bands=VISIBLE,
        compensate="off",
    )
    result = deglint.remove_glint(SENTINEL2 / "palau.tif", tmp_path / "out.tif", recipe)
    model = result.fitted.model
    assert {f.n for f in model.fits} == {12000}
    assert model.indexes[0].level == 151
    assert tuple(round(f.slope, 6) for f in model.fits) == PUBLISHED
    np.testing.assert_allclose(
        values(tmp_path / "out.tif"), values(SENTINEL2 / "palau_hedley_reference.tif"), atol=2e-4, rtol=0
    )


def test_palau_automatic_sample_is_as_good_as_the_drawn_one(tmp_path):
    palau = SENTINEL2 / "palau.tif"
    hedley = deglint.fit_scene(deglint.open_scene(palau), deglint.Recipe(method="hedley", compensate="off"))
    slopes = {f.name: f.slope for f in hedley.model.fits}
    for name, published in zip(VISIBLE, PUBLISHED, strict=True):
        assert slopes[name] == pytest.approx(published, rel=0.1)
    deglint.remove_glint(palau, tmp_path / "out.tif")
    inside = deep_water()
    left = values(tmp_path / "out.tif")[:, inside].std(axis=1)
    assert (left <= 1.05 * np.array([13.45, 12.72, 19.30])).all()
    raw = values(SENTINEL2 / "palau.tif")[:, inside].std(axis=1)
    assert raw == pytest.approx([27.63, 27.60, 29.82], abs=0.005)


@pytest.mark.parametrize("name", ["casablanca", "honolulu"])
def test_land_is_copied_and_integers_stay_integers(name, tmp_path):
    source, out, flags = SENTINEL2 / f"{name}.tif", tmp_path / "out.tif", tmp_path / "flags.tif"
    deglint.remove_glint(source, out, deglint.Recipe(method="lyzenga"), flags=flags)
    with rasterio.open(source) as a, rasterio.open(out) as b, rasterio.open(flags) as f:
        assert (a.dtypes, a.crs, a.transform, a.descriptions) == (b.dtypes, b.crs, b.transform, b.descriptions)
        before, after, flag = a.read(), b.read(), f.read(1)
    town = (slice(-60, None), slice(0, 120)) if name == "casablanca" else (slice(60, 200), slice(60, 110))
    assert (flag[town] & 2 > 0).mean() > 0.8
    np.testing.assert_array_equal(before[:, flag & 4 == 0], after[:, flag & 4 == 0])


def test_a_reef_is_water_and_is_corrected(tmp_path):
    result = deglint.remove_glint(SENTINEL2 / "wistari.tif", tmp_path / "out.tif")
    assert result.counts.not_water < 0.001 * result.counts.total
