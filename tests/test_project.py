"""What the project says of itself: README, docs and tables agree with the code."""

import doctest
import importlib
import re

import pytest

import deglint
from deglint import sensors
from deglint.compensate import STAGES
from deglint.pipeline import FLAGS
from deglint.remove import METHODS, REGRESSIONS
from detect.global_rx import DETECTORS

from .common import ROOT

SOURCES = sorted(path for room in ("deglint", "detect") for path in (ROOT / room).rglob("*.py"))
EXAMPLES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for path in SOURCES
    if ">>> " in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize(
    ("page", "tables"),
    [("methods", (METHODS, REGRESSIONS)), ("compensation", (STAGES,)), ("detection", (DETECTORS,))],
)
def test_every_entry_of_the_tables_is_documented(page, tables):
    text = (ROOT / "docs" / f"{page}.md").read_text()
    assert [name for table in tables for name in table if not re.search(rf"`{name}[`\[]", text)] == []


def test_every_flag_is_documented():
    text = (ROOT / "docs" / "methods.md").read_text()
    assert all(f"| {bit} |" in text for bit in FLAGS)


def test_the_picture_of_the_architecture_shows_modules_and_tables_that_exist():
    text = (ROOT / "docs" / "architecture.svg").read_text()
    boxes = re.findall(r'class="module"[^>]*>([^<]+)</text>\n<text class="does"[^>]*>([A-Z]+(?=:))?', text)
    assert len(boxes) >= 10
    for names, table in boxes:
        modules = [importlib.import_module(name) for name in names.split(", ")]
        assert not table or len(getattr(modules[0], table)) > 0


def test_a_name_that_is_not_there_is_an_attribute_error():
    with pytest.raises(AttributeError, match="deglint attribute nonsense"):
        deglint.nonsense  # noqa: B018


def test_sensor_presets_load():
    for name in sensors.names():
        assert sensors.load(name).bands


def test_the_sample_scene_is_described():
    scene = deglint.open_scene(ROOT / "sample_data" / "sea.tif")
    truth = deglint.open_scene(ROOT / "sample_data" / "sea_truth.tif")
    assert scene.shape == truth.shape == (8, 256, 256)
    assert scene.names == ("COASTAL", "BLUE", "GREEN", "YELLOW", "RED", "REDEDGE", "NIR1", "NIR2")
    assert all(b.wavelength and b.time_offset is not None and b.saturation and b.group for b in scene.bands)


def test_the_sample_scene_is_what_its_command_makes(tmp_path):
    """The command in its README, run again, gives the same pixels (to what other versions of libraries change)."""
    import numpy as np

    from deglint.cli import run

    text = (ROOT / "sample_data" / "README.md").read_text()
    found = re.search(r"^deglint (simulate .*) sample_data/sea$", text, re.MULTILINE)
    assert found is not None
    assert run([*found[1].split(), str(tmp_path / "sea"), "-q"]) == 0
    for name in ("sea.tif", "sea_truth.tif"):
        made = deglint.open_scene(tmp_path / name).read()
        kept = deglint.open_scene(ROOT / "sample_data" / name).read()
        np.testing.assert_allclose(made, kept, rtol=1e-3, atol=1e-3 * np.median(kept))


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_in_docstrings_run(name):
    assert doctest.testmod(importlib.import_module(name)).failed == 0


def test_glint_comes_off_the_sample_scenes(tmp_path):
    """Error in percent of the water level, COASTAL to RED; in `sea` each band follows the NIR of its own set."""
    import cv2
    import numpy as np

    from benchmarks.scenes import Known

    samples, out = ROOT / "sample_data", tmp_path / "out.tif"
    result = deglint.remove_glint(samples / "sea.tif", out, dtype="float32")
    assert [result.fitted.model.indexes[f.index].bands[0] for f in result.fitted.model.fits[:3]] == [7, 6, 6]
    assert Known.of(samples / "sea.tif").error(deglint.open_scene(out).read()) < 19
    known = Known.of(samples / "sea_025m.tif")  # boat, swimmers and foam do not count
    deglint.remove_glint(known.path, out, overwrite=True)
    found = [known.error(deglint.open_scene(path).read()) for path in (known.path, out)]
    afloat = (deglint.open_scene(samples / "sea_025m_cover.tif").read() == 3).all(axis=0)
    _, label, sizes, _ = cv2.connectedComponentsWithStats(afloat.astype(np.uint8))
    swimmers = [n for n in range(1, len(sizes)) if sizes[n, cv2.CC_STAT_AREA] < 50]
    red, truth = (deglint.open_scene(p).read(bands=["RED"])[0] for p in (out, samples / "sea_025m_truth.tif"))
    deep = np.median(truth)
    kept = [(red[label == n].mean() - deep) / (truth[label == n].mean() - deep) for n in swimmers]
    assert (len(kept), sum(k > 0.4 for k in kept), sum(k > 0.8 for k in kept)) == (5, 4, 3)
    said = re.search(r"falls from (\d+) % to\s+(\d+) %", (ROOT / "README.md").read_text())
    assert said is not None
    assert found == pytest.approx([float(s) for s in said.groups()], abs=1)


@pytest.mark.parametrize("name", [pytest.param("sea_025m", marks=pytest.mark.slow), "sea_1m"])
def test_the_samples_are_what_their_script_makes(name):
    """To what other versions of libraries change; small enough for the repository, with the truth beside them.

    A last digit that differs makes Poisson's rejection sampling draw again, and all after it: other noise, not more.
    """
    import runpy

    import numpy as np

    from deglint.physics.sensor import noise
    from deglint.simulate import simulate

    folder = ROOT / "sample_data"
    assert (folder / f"{name}.tif").stat().st_size < 2 << 20
    made = simulate(runpy.run_path(str(folder / "make_samples.py"))[name]())
    for part, layer in (("_truth", made.truth), ("_truth_water", made.truth_water)):
        kept = deglint.open_scene(folder / f"{name}{part}.tif").read()
        np.testing.assert_allclose(layer, kept, rtol=2.0**-9, atol=1e-3 * np.median(kept), err_msg=part)
    sensor, kept = made.setup.sensor, deglint.open_scene(folder / f"{name}.tif").read()
    for band, image, radiance in zip(sensor.bands, made.image.astype(float), kept, strict=True):
        per_count, counts = sensor.well / sensor.levels, radiance / sensor.scale(band)
        deviation = noise(per_count * counts, sensor, exposure=sensor.exposure(band)) / per_count
        off = (image - counts) / deviation
        assert np.abs(off).max() < 8, band.name  # two draws are 6 times sqrt(2) apart once in 10^9
        assert abs(off.mean()) < 0.05, band.name
    assert set(np.unique(made.cover)) == {0, 2, 3}  # water, foam of the wakes, boats


def test_citation_recipe_and_changelog_agree_with_the_package():
    import tomllib

    version = re.search(r"^## \[([\d.]+)\]", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[1]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    recipe = (ROOT / "recipe" / "recipe.yaml").read_text()
    assert f'version: "{version}"' in recipe
    names = {"opencv-contrib-python-headless": "py-opencv", "pvlib": "pvlib-python"}
    for wanted in tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]:
        name, least = re.fullmatch(r"([\w-]+)(>=.*)", wanted).groups()
        assert f"- {names.get(name, name)} {least}" in recipe
        assert name in (ROOT / "docs" / "dependencies.md").read_text()


def test_tutorials_are_short_and_the_site_needs_what_it_declares():
    import tomllib

    scripts = sorted((ROOT / "docs" / "gallery").glob("plot_*.py"))
    assert len(scripts) >= 7
    assert all(len(path.read_text().splitlines()) <= 40 for path in scripts)
    extra = " ".join(
        tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]["docs"]
    ).replace("-", "_")
    settings = (ROOT / "docs" / "conf.py").read_text()
    for name in ("myst_parser", "numpydoc", "sphinx_click", "sphinx_gallery", "pydata_sphinx_theme"):
        assert name in settings
        assert name in extra
