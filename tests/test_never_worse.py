"""By default no band is worse than as it was, and the visible bands not worse than after Hedley or Joyce."""

from dataclasses import replace

import numpy as np
import pytest
import rasterio

from deglint import Recipe, correct, fit_scene, open_scene
from deglint.raster.simulated import write_scene

from .common import simulated_squares

WORSE = 1.01
LITTLE = 0.01  # of the water: where glint is as weak, the image is copied, and a method may be this much better
SIDE, VISIBLE = 160, 5


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Scenes by wind, view and optics, as files, made once; with glint, or without, or without it in a half."""
    place = tmp_path_factory.mktemp("away")

    def make(wind, zenith, sensor="thesis", delay=0.06, glint="everywhere"):
        scene = simulated_squares(SIDE, wind, delay, sensor, view_zenith=zenith, view_azimuth=135.0)
        image = scene.image.copy()
        if glint != "everywhere":
            part = slice(SIDE // (1 if glint == "nowhere" else 2))
            image[..., part] = scene.truth_image[..., part]
        write_scene(replace(scene, image=image), place / "scene", overwrite=True, truth=False)
        return open_scene(place / "scene.tif"), scene.truth.astype(np.float64)

    return make


def errors(image, truth, columns=slice(None)):
    """Root mean square error of each band."""
    return np.sqrt(((image.astype(np.float64) - truth)[..., columns] ** 2).mean(axis=(1, 2)))


def ratios(scene, truth, columns=slice(None)):
    """Error of each band by default over that of the raw one, and the fit."""
    fitted = fit_scene(scene, Recipe())
    return errors(correct(scene, fitted), truth, columns) / errors(scene.read(), truth, columns), fitted


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wind", "zenith", "sensor", "delay"),
    [(5.0, 40.0, "thesis", 0.0), (5.0, 20.0, "thesis-f30", 0.06), (9.0, 40.0, "thesis", 0.06)],
)
def test_looking_away_from_the_glint(made, wind, zenith, sensor, delay):
    assert ratios(*made(wind, zenith, sensor=sensor, delay=delay))[0].max() <= WORSE


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wind", "zenith", "delay"), [(5.0, 0.0, 0.06), (7.0, 0.0, 0.0), (5.0, 20.0, 0.0), (9.0, 40.0, 0.06)]
)
def test_methods_of_the_papers_are_not_better(made, wind, zenith, delay):
    scene, truth = made(wind, zenith, delay=delay)
    level = np.median(truth, axis=(1, 2))[:VISIBLE]

    def error(recipe):
        return np.sqrt(((errors(correct(scene, fit_scene(scene, recipe)), truth)[:VISIBLE] / level) ** 2).mean())

    ours = error(Recipe())
    for method in ("hedley", "joyce"):
        assert ours <= WORSE * error(Recipe(method=method, compensate="off")) + LITTLE, method


@pytest.mark.slow
@pytest.mark.parametrize(("wind", "delay"), [(5.0, 0.0), (7.0, 0.0), (9.0, 0.06)])
def test_the_size_of_a_pixel_need_not_be_known(made, tmp_path, wind, delay):
    """Images of drones have no coordinates; their flashes are glint all the same."""
    scene, truth = made(wind, 0.0, delay=delay)
    with rasterio.open(scene.path) as file:
        profile, image = file.profile, file.read()
        scales, tags = file.scales, [file.tags(i) for i in file.indexes]
    profile.update(crs=None, transform=None)
    with rasterio.open(tmp_path / "bare.tif", "w", **profile) as file:
        file.write(image)
        file.scales = scales
        for i, known in enumerate(tags, 1):
            file.update_tags(i, **known)
    known, bare = (
        errors(correct(s, fit_scene(s)), truth)[:VISIBLE].mean() for s in (scene, open_scene(tmp_path / "bare.tif"))
    )
    assert bare < 1.5 * known


@pytest.mark.slow
@pytest.mark.parametrize("sensor", ["thesis", "thesis-f30"])
def test_without_glint_nothing_is_changed_whatever_lies_in_the_water(made, sensor):
    found, fitted = ratios(*made(5.0, 0.0, sensor=sensor, glint="nowhere"))
    assert (found == 1).all()
    assert fitted.choice.best.method == "copy"


@pytest.mark.slow
def test_a_half_without_glint(made):
    found, _fitted = ratios(*made(5.0, 0.0, glint="half"), slice(SIDE // 2))
    assert np.sqrt(np.mean(found**2)) <= WORSE
