"""What the project says of itself: README, docs and tables agree with the code."""

import subprocess
import sys
from pathlib import Path

import pytest

import deglint
from deglint import sensors
from deglint.pipeline import FLAGS
from deglint.remove import METHODS, REGRESSIONS

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("name", [*METHODS, *REGRESSIONS])
def test_every_method_and_regression_is_documented(name):
    assert f"`{name}`" in (ROOT / "docs" / "methods.md").read_text()


def test_every_flag_is_documented():
    text = (ROOT / "docs" / "methods.md").read_text()
    assert all(f"| {bit} |" in text for bit in FLAGS)


def test_public_names_exist():
    for name in deglint.__all__:
        assert getattr(deglint, name) is not None
    with pytest.raises(AttributeError, match="no attribute"):
        deglint.nonsense  # noqa: B018


def test_sensor_presets_load():
    for name in sensors.names():
        assert sensors.load(name).bands


@pytest.mark.parametrize("name", ["sea", "sea_delayed"])
def test_sample_scenes_are_described(name):
    scene = deglint.open_scene(ROOT / "sample_data" / f"{name}.tif")
    truth = deglint.open_scene(ROOT / "sample_data" / f"{name}_truth.tif")
    assert scene.shape == truth.shape == (8, 384, 384)
    assert scene.names == ("COASTAL", "BLUE", "GREEN", "YELLOW", "RED", "REDEDGE", "NIR1", "NIR2")
    assert all(b.wavelength and b.time_offset is not None and b.saturation for b in scene.bands)


def test_documented_scripts_run():
    """The docstring examples of the public modules."""
    modules = [
        "deglint.moments",
        "deglint.remove.model",
        "deglint.remove",
        "deglint.remove.detrend",
        "deglint.masks.surface",
    ]
    code = (
        "import doctest, importlib, sys\n"
        f"sys.exit(sum(doctest.testmod(importlib.import_module(m)).failed for m in {modules!r}))"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_hedley_takes_the_glint_off_the_sample_scene(tmp_path):
    """Error left in percent of the water level, against truth: glint at 9 m/s is several times the water."""
    import numpy as np

    out = tmp_path / "out.tif"
    deglint.remove_glint(ROOT / "sample_data" / "sea.tif", out, dtype="float32")
    truth = deglint.open_scene(ROOT / "sample_data" / "sea_truth.tif").read()[:5]

    def error(path):
        rest = (deglint.open_scene(path).read()[:5] - truth) ** 2
        return 100 * np.sqrt((rest.mean(axis=(1, 2)) / np.median(truth, axis=(1, 2)) ** 2).mean())

    raw, left = error(ROOT / "sample_data" / "sea.tif"), error(out)
    assert raw > 400
    assert left < 0.15 * raw
