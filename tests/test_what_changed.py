"""What a run says it changed, held against what it changed: over every method and chain, band by band."""

from pathlib import Path

import numpy as np
import pytest
from rasterio.transform import from_origin

from deglint import Recipe, remove_glint
from deglint.remove import METHODS

from .common import at_wavelengths

SAMPLE = Path(__file__).parents[1] / "sample_data" / "sea.tif"
PALAU = Path(__file__).parents[2] / "shared" / "data" / "sentinel2" / "palau.tif"
SLOPES = {480: 1.1, 560: 1.05, 640: 1.0, 739: 0.95, 760: 0.9, 775: 0.9, 842: 0.9}
PLACE = from_origin(400_000, 800_000, 0.5, 0.5)
CHAINS = ("off", "auto", "thesis")


@pytest.fixture
def small(write, tmp_path):
    """A rough sea of 0.5 m pixels whose bands every method can use, with a boat, which no reference follows."""
    rng = np.random.default_rng(5)
    level = np.array([900.0, 700, 400, 200, 120, 110, 100])[:, None, None]
    glint = rng.gamma(0.4, 150.0, (160, 200)) * np.array(list(SLOPES.values()))[:, None, None]
    sea = level + glint + rng.normal(0, 4, glint.shape)
    sea[:, 60:72, 80:92] += 4000
    values = np.rint(sea).clip(1, 60_000).astype(np.uint16)
    known = {"names": [f"L{w}" for w in SLOPES], "band_tags": at_wavelengths(*SLOPES)}
    return write(tmp_path / "sea.tif", values, transform=PLACE, **known)


@pytest.mark.slow
@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("method", ["auto", *METHODS])
def test_the_bands_that_are_said_to_change_are_those_that_change(method, chain, small, read, tmp_path):
    if (method, chain) == ("wiener", "thesis"):
        pytest.skip("wiener takes no compensation")
    _check(small, Recipe(method=method, compensate=chain), read, tmp_path)


@pytest.mark.parametrize("chain", CHAINS)
def test_references_that_are_corrected_change_too(chain, read, tmp_path):
    result = _check(SAMPLE, Recipe(method="multiband", compensate=chain), read, tmp_path)
    assert {"RED", "REDEDGE"} <= set(result.changed)


def _check(source, recipe, read, tmp_path):
    out = tmp_path / "out.tif"
    result = remove_glint(source, out, recipe, threads=1, flags=tmp_path / "flags.tif", amount=tmp_path / "amount.tif")
    before, after = read(source), read(out)
    names = [b["name"] for b in result.sidecar["bands"]]
    differs = {name: int(np.count_nonzero(a != b)) for name, a, b in zip(names, after, before, strict=True)}
    said = result.sidecar["pixels"]["changed"]
    assert {name for name, n in differs.items() if n} == set(said) == set(result.changed)
    assert all(differs[name] <= said[name] for name in said)
    assert set(result.sidecar["recipe"]["bands"]) <= set(said)
    copied = {name for name in names if result.sidecar["skipped"].get(name, "").endswith(": copied")}
    assert copied == set(names) - set(said)
    flags = read(tmp_path / "flags.tif")[0]
    touched = (after != before).any(axis=0)
    assert not touched[flags & (4 | 64 | 128) == 0].any()
    return result


@pytest.mark.shared
def test_the_references_of_a_real_scene_change_too(read, tmp_path):
    if not PALAU.exists():
        pytest.skip("the scene of Palau does not lie beside the project")
    result = _check(PALAU, Recipe(method="multiband", compensate="off"), read, tmp_path)
    assert {"B04", "B05", "B06", "B07"} <= set(result.changed)
