"""Sparkle and land: what is glint is water, however wide it is, and what is land stays land beside it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import rasterio

from deglint import open_scene
from deglint.masks import Roles, WaterRule, fit_water, water
from deglint.physics.presets import preset
from deglint.pipeline.messages import log_water
from deglint.pipeline.overview import overview_of
from deglint.simulate import Bottom, Setup, simulate

from .common import says
from .test_masks import LAND, ROLES, open_water, put, sparkling_sea, tiled

FINE, COARSE = 0.4, 10.0


def simulated(**setup):
    """A simulated sea in physical units, (band, row, column)."""
    bands = setup["sensor"].bands
    steps = np.array([b.full_scale for b in bands], np.float32)[:, None, None] / setup["sensor"].levels
    return simulate(Setup(**setup)).image * steps


def test_clumps_of_sparkle_are_water_up_to_the_size_of_waves():
    """5 m at 0.4 m are 13 pixels; a pier of 14 is wider."""
    scene = sparkling_sea()
    calm = np.array([0.05, 0.03, 0.015, 0.005])[:, None, None]
    scene[:, :, 128:] = (calm + np.random.default_rng(2).normal(0, 5e-4, (4, 256, 128))).astype(np.float32)
    clumps, pier = np.zeros((2, 256, 256), bool)
    for place, width in enumerate((5, 5, 6, 6, 7, 8, 9, 10, 11)):
        clumps[26 * place + 5 : 26 * place + 5 + width, 60 : 60 + width] = True
    pier[100:200, 200:214] = True
    scene[:, clumps] += 0.5
    put(scene, pier, LAND)
    found = water(scene, fit_water([scene], ROLES, pixel=FINE))
    assert found[clumps].all()
    assert not found[pier].any()
    assert found[~clumps & ~pier].mean() > 0.998


def test_bright_spots_are_glint_at_fine_pixels_and_boats_at_coarse_ones():
    scene, spots = open_water(glint=0.0), np.zeros((200, 240), np.uint8)
    rows, columns = np.random.default_rng(6).integers(10, 190, (2, 60))
    spots[rows, columns] = 1
    spots = cv2.dilate(spots, np.ones((7, 7), np.uint8)) > 0
    put(scene, spots, (0.8, 0.8, 0.7, 0.45))
    for pixel, share in ((COARSE, 0), (FINE, 1)):
        found = water(scene, fit_water([scene], ROLES, pixel=pixel))
        assert found[spots].mean() == share
        assert found[~spots].all()
    put(scene, np.indices((200, 240))[1] > 210, LAND, 0.25)
    assert not water(scene, fit_water([scene], ROLES, pixel=FINE))[:, 211:].any()


def test_limits_that_are_not_used_are_not_said():
    rule = WaterRule(ROLES, threshold=np.inf, window=5, bright=0.05, core=7, water_fraction=0.97, pixels=1000)
    assert rule.reason.endswith("(NIR above 0.05 over 7 x 7 pixels)")
    assert replace(rule, threshold=0.1).reason.endswith("(NIR above 0.1 over 5 x 5 pixels, or 0.05 over 7 x 7 pixels)")


@pytest.mark.parametrize(("sides", "said"), [({}, False), ({"window": 7}, True), ({"core": 7}, True)])
def test_what_fills_squares_may_be_dense_glint(sides, said, caplog):
    rule = WaterRule(ROLES, threshold=0.1, bright=0.05, water_fraction=0.97, pixels=1000, **sides)
    with caplog.at_level("INFO", "deglint"):
        log_water(rule, "auto")
        log_water(rule, "none")  # then it is done already
    assert [says(line, "If it is glint: --mask none") for line in caplog.messages] == [said, False]
    assert says(caplog.messages[1], "all is corrected")


def test_bright_spots_of_unknown_size_are_boats_only_near_land_and_only_at_some_places():
    land = np.indices((200, 240))[1] > 180
    for seen, count, share in ((False, 12, 1), (True, 12, 0), (True, 300, 1)):
        scene, spots = open_water(glint=0.0), np.zeros((200, 240), np.uint8)
        rows, columns = np.random.default_rng(6).integers(2, 150, (2, count))
        spots[rows, columns] = 1
        spots = cv2.dilate(spots, np.ones((2, 2), np.uint8)) > 0
        put(scene, spots, (0.8, 0.8, 0.7, 0.45))
        if seen:
            put(scene, land, LAND, 0.25)
        assert water(scene, fit_water([scene], ROLES))[spots].mean() == share


def test_flashes_that_the_nir_alone_has_caught_are_no_land():
    """Bands that are not simultaneous: what is bright in the NIR is in no other."""
    scene = open_water(glint=0.0)
    rows, columns = np.random.default_rng(7).integers(0, 200, (2, 120))
    scene[3, rows, columns] += 0.6
    assert water(scene, fit_water([scene], ROLES, pixel=FINE)).all()
    put(scene, np.indices((200, 240))[1] > 210, LAND, 0.25)
    found = water(scene, fit_water([scene], ROLES, pixel=FINE))
    assert not found[:, 211:].any()
    assert found[:, :205].all()


@pytest.mark.parametrize("pixel", [FINE, None])
def test_sparkle_is_water_and_land_beside_it_is_not(pixel):
    scene = sparkling_sea()
    assert (scene[3] > 0.05).mean() > 0.25
    assert water(scene, fit_water([scene], ROLES, pixel=pixel)).mean() > 0.99
    land = np.zeros(scene.shape[1:], bool)
    land[60:180, :90] = True
    put(scene, land, LAND, 0.2)
    rule = fit_water([scene], ROLES, pixel=pixel)
    found = water(scene, rule)
    assert rule.window > 1
    assert found[~land].mean() > 0.99
    assert found[land].mean() < 0.01


def near_a_corner(strength, shape=(576, 576), seed=0):
    """Wide patches of glint, (row, column), ever denser and brighter toward one corner, as a low camera sees them."""
    rows, columns = np.indices(shape)
    near = np.exp(-(rows**2 + columns**2) / (2 * 110.0**2))
    facets = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=shape), (0, 0), 2.5)
    return strength / 1.5 * near * np.clip(facets / facets.std() + 3 * near - 1, 0, 1.5)


def turbid(glint, red=1.0, seed=1):
    """Turbid water in reflectance, (band, row, column), whose red is `red` times its green."""
    level = np.array([0.007, 0.012, 0.012 * red, 0.004])[:, None, None]
    noise = np.random.default_rng(seed).normal(0, 2e-4, (4, *glint.shape))
    return (level + glint * np.array([1, 1, 0.95, 0.6])[:, None, None] + noise).astype(np.float32)


def blocks_of(scene, side=192):
    """The blocks of a scene, as an overview reads them."""
    return [scene[:, y : y + side, x : x + side] for y in range(0, 576, side) for x in range(0, 576, side)]


@pytest.mark.parametrize("row", [440, 380])
@pytest.mark.parametrize(("pixel", "strength"), [(None, 0.04), (FINE, 0.04), (None, 0.2)])
def test_glint_in_one_corner_is_water_and_a_boat_in_the_calm_is_not(pixel, strength, row):
    """The calm squares do not show how bright glint is; without a georeference it may be as bright as clouds.

    At row 380, the blocks from which the rule is determined cut the boat.
    """
    scene, hull = turbid(near_a_corner(strength)), np.s_[row : row + 9, 250:286]
    assert water(scene, fit_water(blocks_of(scene), ROLES, pixel=pixel)).mean() > 0.9995
    scene[:, *hull] = np.array([0.5, 0.48, 0.45, 0.3])[:, None, None]
    found = water(scene, fit_water(blocks_of(scene), ROLES, pixel=pixel))
    assert not found[hull].any()
    assert found.sum() > 0.999 * (found.size - 9 * 36)


def test_glint_in_one_corner_of_the_frame_of_a_drone_is_water(tmp_path):
    """All of the frame is searched, as tiles spread over it may not show how bright glint is."""
    with rasterio.open(tmp_path / "a.tif", "w", "GTiff", 1280, 960, 4, dtype="float32") as out:
        out.write(turbid(near_a_corner(0.2, (960, 1280))))
        out.descriptions = "BLUE", "GREEN", "RED", "NIR"
    scene = open_scene(tmp_path / "a.tif")
    rule = overview_of(scene, 3, threads=1).water
    assert water(scene.read(), rule).mean() > 0.9999


@pytest.mark.parametrize("pixel", [None, 0.1])
@pytest.mark.parametrize(("red", "nir", "share"), [(0.99, 1, 1), (1.003, 1, 1), (1.2, 1, 1), (1.2, 2.5, 0)])
def test_turbid_water_without_land_is_water(red, nir, share, pixel):
    """It is darker in the NIR than a town in an image of radiance, which is as brown; no land is in view to compare."""
    scene = turbid(np.zeros((576, 576)), red) * np.array([1, 1, 1, nir], np.float32)[:, None, None]
    assert fit_water(blocks_of(scene), ROLES, pixel=pixel).water_fraction == pytest.approx(share, abs=1e-3)


def test_dry_sand_beside_a_sparkling_shallow_stays_land():
    """Its red is above its green and its NIR below its blue: its colour votes for neither, and only the gap tells."""
    setup = Setup(
        sensor=preset("worldview3"), size=(192, 192), wind=8.0, seed=5, bottom=Bottom(depth=(20.0, 2.0)), coast=60.0
    )
    scene = simulate(setup)
    land = cv2.erode((scene.truth[7] > 0.045).astype(np.uint8), np.ones((5, 5))) > 0
    steps = [b.full_scale / 2047 for b in setup.sensor.bands]  # of 11 bits
    image = (scene.image * np.array(steps)[:, None, None]).astype(np.float32)
    rule = fit_water([image], Roles(nir=7, blue=1, green=2, red=4), pixel=1.24)
    assert land.mean() > 0.1
    assert not water(image, rule)[land].any()


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.06])
@pytest.mark.parametrize(("wind", "width"), [(8.0, 12), (5.0, 8)])
def test_boats_rocks_and_plants_in_glint_are_not_water(delay, wind, width):
    """2 or 3 m by 9 m at 0.25 m, as bright as a white hull, a wet rock, or plants with little red; the rest is sea."""
    sensor = preset("thesis").delayed(delay)
    sea = simulated(sensor=sensor, size=(256, 256), wind=wind, seed=11)
    roles, afloat = Roles(nir=6, blue=1, green=2, red=4), np.zeros((256, 256), bool)
    assert water(sea, fit_water([sea], roles, pixel=0.25)).all()
    light = np.median(sea[6]) * 150
    for column, spectrum in (70, (1.5, 1.4, 1.2, 1.0)), (140, (0.2, 0.3, 0.4, 0.5)), (200, (0.1, 0.15, 0.1, 1.0)):
        hull = slice(100, 100 + width), slice(column, column + 36)
        afloat[hull] = True
        for band, share in zip((1, 2, 4, 6), spectrum, strict=True):
            sea[(band, *hull)] = share * light
    rule = fit_water([sea], roles, pixel=0.25)
    found = water(sea, rule)
    np.testing.assert_array_equal(tiled(water, sea, rule), found)
    assert not found[afloat].any()
    assert found[~afloat].mean() > 0.999


@pytest.mark.slow
@pytest.mark.parametrize("wind", [4.0, 6.0])
def test_boats_of_three_metres_are_found_at_half_a_metre(wind):
    """A rock of 6 by 20 pixels, no brighter in the NIR than in the visible, is wider than sparkle is in such pixels."""
    sensor = replace(preset("thesis"), gsd=0.5).delayed(0.06)
    sea = simulated(sensor=sensor, size=(320, 320), wind=wind, patch=0.06, seed=12)
    roles, boat = Roles(nir=6, blue=1, green=2, red=4), np.s_[100:106, 80:100]
    light = np.percentile(sea[6], 99.9)  # as bright as the brightest sparkle
    for band, share in zip((1, 2, 4, 6), (0.8, 1.0, 1.2, 1.0), strict=True):
        sea[(band, *boat)] = share * light
    found = water(sea, fit_water([sea], roles, pixel=0.5))
    assert not found[boat].any()
    found[boat] = True
    assert found.mean() > 0.9999


@pytest.mark.slow
def test_saturated_boats_among_saturated_glint_are_not_water():
    """In a drone's image both reach full scale; the boat does so all over squares of 13 pixels, the glint does not."""
    sensor = replace(preset("micasense"), gsd=0.16)
    sea = simulated(sensor=sensor, size=(320, 320), wind=8.0, sun_zenith=21.0, patch=0.02, seed=3)
    boat = np.s_[100:118, 80:130]
    assert (sea[3] == sea[3].max()).mean() > 0.01
    roles = ROLES
    assert water(sea, fit_water([sea], roles, pixel=0.16)).all()
    sea[:, *boat] = sea.max(axis=(1, 2))[:, None, None]
    found = water(sea, fit_water([sea], roles, pixel=0.16))
    assert not found[boat].any()
    found[boat] = True
    assert found.mean() > 0.999


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "gsd"), [("thesis", 0.15), ("thesis-f30", 0.3), ("micasense", 0.2), ("worldview3", 0.5)]
)
@pytest.mark.parametrize("wind", [4.0, 11.0])
@pytest.mark.parametrize("known", [True, False])
def test_the_brightest_glint_of_a_sea_is_water(name, gsd, wind, known):
    """Its squares of 7 pixels, or 5 of half a metre, stay below the brightest clumps of three quarters of the sea."""
    sensor = replace(preset(name), gsd=gsd)
    nir = min(range(len(sensor.bands)), key=lambda i: abs(sensor.bands[i].wavelength - 840))
    sea = simulated(sensor=sensor, size=(320, 320), wind=wind, sun_zenith=30.0, seed=21)
    rule = fit_water([sea], Roles(nir=nir, green=1), pixel=gsd if known else None)
    assert min(rule.core, rule.red_core) >= (5 if known and gsd > 0.39 else 7)
    assert water(sea, rule).mean() > 0.9999


def test_boats_are_not_sought_where_too_little_sea_is_in_view_to_compare_with():
    scene = sparkling_sea()[:, :100, :100]
    rule = fit_water([scene], ROLES, pixel=0.25)
    assert (rule.core, rule.red_core) == (1, 1)
    assert np.isinf([rule.bright, rule.red]).all()


def test_land_whose_nir_is_saturated_is_no_water():
    """Cameras set for the sea clip the NIR of a beach below its green."""
    scene = sparkling_sea()
    beach = np.indices((256, 256))[1] > 110
    put(scene, beach, (0.3, 0.4, 0.45, 0.5), 0.2)
    scene[:, 200:, 180:] = np.array([0.04, 0.08, 0.05, 0.4])[:, None, None]  # plants
    scene = np.minimum(scene, np.array([0.4, 0.4, 0.32, 0.2], np.float32)[:, None, None])
    found = water(scene, fit_water([scene], ROLES, pixel=0.1))
    assert found[~beach].mean() > 0.99
    assert found[beach].mean() < 0.01
