"""How scenes, models and results show themselves: short text, and pictures in natural colours."""

import builtins
from dataclasses import replace

import numpy as np
import pytest
import rasterio

import deglint
import detect
from deglint import Recipe
from deglint.errors import InputError
from deglint.plotting import LONGEST_PICTURE, natural_colour


@pytest.fixture
def done(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea(), names=("blue", "green", "red", "nir"))
    recipe = Recipe(method="hedley", sample="all", mask="none", compensate="off")
    return deglint.open_scene(source), deglint.remove_glint(source, tmp_path / "out.tif", recipe)


def test_texts_are_short(done, tmp_path):
    scene, result = done
    scored = detect.score_file(scene.path, tmp_path / "scores.tif", detect.Recipe(pfa=1e-2))
    for value, said in (
        (scene, "4 bands, 100 x 80 pixels"), (result, "hedley, 8000 of 8000 pixels"), (result.fitted, "hedley"),
        (result.fitted.model, "GlintModel(hedley: blue, green"), (scored, "8000 of 8000 pixels scored, threshold"),
    ):  # fmt: skip
        assert said in repr(value)
        assert len(repr(value)) < 300


def test_a_scene_and_a_result_draw_themselves(done):
    pytest.importorskip("matplotlib").use("agg")
    scene, result = done
    (shown,) = scene.plot().images
    assert shown.get_array().shape == (80, 100, 3)
    (both,) = result.plot().images
    before, after = np.split(np.asarray(both.get_array(), float), 2, axis=1)
    assert before.shape == after.shape
    assert after.mean() < before.mean()
    ax = scene.plot()
    assert result.plot(ax) is ax


def test_a_result_reads_its_scene_again_as_it_was_opened(sea, write, tmp_path):
    pytest.importorskip("matplotlib").use("agg")
    recipe, shown = Recipe(method="hedley", sample="all", mask="none", compensate="off"), []
    for name, options in (("said", {}), ("given", {"scale": 1e-4, "offset": -0.1})):
        source = write(tmp_path / f"{name}.tif", sea())
        if not options:
            with rasterio.open(source, "r+") as dataset:
                dataset.scales, dataset.offsets = [1e-4] * 4, [-0.1] * 4
        (tmp_path / f"{name}.tif.aux.xml").write_text("<PAMDataset/>")
        result = deglint.remove_glint(source, tmp_path / f"{name}_out.tif", recipe, **options)
        shown.append(result.plot().images[0].get_array())
    np.testing.assert_array_equal(*shown)
    assert np.split(shown[0], 2, axis=1)[1].mean() > 30


def test_a_large_scene_is_read_in_squares_and_thinned(sea, write, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib").use("agg")
    monkeypatch.setattr("deglint.plotting.AT_ONCE", 301)
    scene = deglint.open_scene(write(tmp_path / "in.tif", sea(1300, 950)))
    sizes = []

    class Source:
        def read(self, window, bands):
            sizes.extend(stop - start for start, stop in window)
            return scene.source.read(window, bands)

    (shown,) = replace(scene, source=Source()).plot().images
    assert max(sizes) == 300
    assert shown.get_array().shape == (650, 475, 3)
    assert max(shown.get_array().shape) <= LONGEST_PICTURE
    whole = scene.read(bands=scene.rgb(range(len(scene.bands))))[:, ::2, ::2]
    np.testing.assert_array_equal(shown.get_array(), natural_colour([whole])[0])


def test_without_matplotlib_a_line_says_what_to_install(done, monkeypatch):
    known = builtins.__import__

    def imported(name, *args, **kwargs):
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return known(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", imported)
    for value in done:
        with pytest.raises(InputError, match=r"needs matplotlib.*reports"):
            value.plot()


def test_glint_is_white_and_water_keeps_its_colour():
    water = np.array([0.02, 0.06, 0.08])[:, None, None] * np.ones((3, 50, 50))
    glint = np.array([0.9, 1.0, 1.1])[:, None, None] * np.eye(50) * np.linspace(0.5, 1, 50)
    raw, clean = natural_colour([water + glint, water])
    flash = raw[-1, -1].astype(int)
    assert flash.min() > 200
    assert np.ptp(flash) < 12
    red, green, blue = clean[10, 20].astype(int)
    assert red < green < blue


def test_what_is_not_valid_is_black():
    image = np.random.default_rng(0).random((3, 20, 20))
    image[:, 3] = np.nan
    (picture,) = natural_colour([image])
    assert not picture[3].any()
    assert picture[4:].max() == 255
    assert not natural_colour([np.full((3, 4, 4), np.nan)])[0].any()
