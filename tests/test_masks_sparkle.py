"""Sparkle and land: what is glint is water, however wide it is, and what is land stays land beside it."""

import numpy as np
import pytest

from deglint.masks import fit_water, water

from .test_masks import LAND, ROLES, put, sea, sparkling_sea


def half_sparkling(seed=2):
    """Sparkle in the left half, with some clumps of it 5 to 11 pixels wide, as bright as anything."""
    scene, calm = sparkling_sea(seed=seed), np.array([0.05, 0.03, 0.015, 0.005])[:, None, None]
    rng = np.random.default_rng(seed)
    scene[:, :, 128:] = (calm + rng.normal(0, 5e-4, (4, 256, 128))).astype(np.float32)
    clumps = np.zeros((256, 256), bool)
    for place, width in enumerate((5, 5, 6, 6, 7, 8, 9, 10, 11)):
        clumps[26 * place + 5 : 26 * place + 5 + width, 60 : 60 + width] = True
    scene[:, clumps] += 0.5
    return scene, clumps


def test_clumps_of_sparkle_are_water_up_to_the_width_of_what_may_be_lost():
    scene, clumps = half_sparkling()
    pier = np.zeros_like(clumps)
    pier[100:200, 200:214] = True
    put(scene, pier, LAND)
    kept, lost = (water(scene, fit_water([scene], ROLES, lost=n)) for n in (0, 13))
    assert kept[clumps].mean() < 0.7
    assert lost[clumps].all()
    for mask in (kept, lost):
        assert not mask[pier].any()
        assert mask[~clumps & ~pier].mean() > 0.999


def test_blurred_sparkle_is_as_wide_as_a_boat_but_not_as_what_is_to_be_kept():
    """Spots of the colour of glint, of which one pixel more or less is no great matter; land of any size is none."""
    import cv2

    scene, spots = sea(glint=0.0), np.zeros((200, 240), np.uint8)
    rows, columns = np.random.default_rng(6).integers(10, 190, (2, 60))
    spots[rows, columns] = 1
    spots = cv2.dilate(spots, np.ones((7, 7), np.uint8)) > 0
    put(scene, spots, (0.8, 0.8, 0.7, 0.45))
    for lost, share in ((0, 0), (13, 1)):
        found = water(scene, fit_water([scene], ROLES, lost=lost))
        assert found[spots].mean() == share
        assert found[~spots].all()
    put(scene, np.indices((200, 240))[1] > 210, LAND, 0.25)
    assert not water(scene, fit_water([scene], ROLES, lost=13))[:, 211:].any()


def test_flashes_that_the_nir_alone_has_caught_do_not_make_land_of_clumps():
    """Bands of different instants: what is bright in the NIR is mostly in no other; within 3 x 3 it is glint."""
    scene, clumps = sea(glint=0.0), np.zeros((200, 240), bool)
    rows, columns = np.random.default_rng(7).integers(0, 200, (2, 120))
    scene[3, rows, columns] += 0.6
    for place, width in enumerate((3, 4, 5, 6)):
        clumps[20 * place + 20 : 20 * place + 20 + width, 100 : 100 + width] = True
    put(scene, clumps, (0.8, 0.8, 0.7, 0.45))
    for lost, share in ((0, 0), (13, 1)):
        assert water(scene, fit_water([scene], ROLES, lost=lost))[clumps].mean() == share
    put(scene, np.indices((200, 240))[1] > 210, LAND, 0.25)
    assert not water(scene, fit_water([scene], ROLES, lost=13))[:, 211:].any()


@pytest.mark.parametrize(("spectrum", "told"), [((0.5, 0.8, 1.0, 0.45), True), (LAND, False)])
def test_what_is_as_blue_as_dense_glint_is_told(spectrum, told):
    """Calm sea beside something bright and even: it is no water, but may be after all."""
    scene = sea()
    put(scene, np.indices((200, 240))[1] < 100, spectrum)
    rule = fit_water([scene], ROLES)
    assert rule.water_fraction == pytest.approx(140 / 240)
    assert rule.bright_ratio == pytest.approx(spectrum[3] / spectrum[1], rel=1e-5)
    assert ("--mask none" in rule.reason) is told


def test_sparkle_is_water_and_land_beside_it_is_not():
    scene = sparkling_sea()
    assert (scene[3] > 0.05).mean() > 0.25
    assert water(scene, fit_water([scene], ROLES)).mean() > 0.99
    land = np.zeros(scene.shape[1:], bool)
    land[60:180, :90] = True
    put(scene, land, LAND, 0.2)
    rule = fit_water([scene], ROLES)
    found = water(scene, rule)
    assert rule.window > 1
    assert found[~land].mean() > 0.99
    assert found[land].mean() < 0.01
