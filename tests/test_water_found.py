"""Water in every kind of scene: made-up seas, rivers, lakes and land with known truth, and real ports.

Spectra are reflectances of blue, green, red and NIR; the unit, an offset that all bands share, and the order of bands
must not matter.
"""

from pathlib import Path

import cv2
import numpy as np
import pytest

from deglint import Recipe, fit_scene, open_scene
from deglint.masks import Roles, fit_water, water

from .common import ROLES, SHARED
from .test_masks import tiled

SHAPE = (180, 200)
CLEAR, TURBID, BROWN = (0.05, 0.03, 0.015, 0.005), (0.08, 0.11, 0.09, 0.04), (0.07, 0.10, 0.13, 0.06)
BRINE, CRUST = (0.16, 0.2, 0.19, 0.12), (0.45, 0.5, 0.55, 0.6)
FOREST, SOIL, TOWN, CLOUD = (0.02, 0.04, 0.02, 0.3), (0.08, 0.11, 0.15, 0.22), (0.15, 0.16, 0.17, 0.19), (0.5,) * 4
GLINT = np.array([0.95, 0.95, 0.95, 1.0])


def smooth(size, seed, amplitude=1.0):
    """Random waves with standard deviation 1."""
    waves = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=SHAPE), (0, 0), size)
    return amplitude * waves / waves.std()


def ground(spectrum, seed, texture=0.25):
    """Land of one kind, with texture of a few pixels."""
    factor = np.exp(smooth(1.2, seed, texture)) * np.exp(
        np.random.default_rng(seed).normal(0, texture / 4, (4, *SHAPE))
    )
    return np.array(spectrum)[:, None, None] * factor


def water_of(spectrum, seed, glint=0.01, sheet=0.0):
    """Water of one kind under waves of glint, on a sheet of glint or haze that is stronger on one side."""
    waves = np.maximum(smooth(1.5, seed) + 2, 0) * glint / 2 + sheet * (0.5 + np.linspace(0, 0.5, SHAPE[1]))
    noise = np.random.default_rng(seed).normal(0, 6e-4, (4, *SHAPE))
    return np.array(spectrum)[:, None, None] + GLINT[:, None, None] * waves + noise


def land_of(*kinds, seed=5):
    """Patches of several kinds of land."""
    which = np.digitize(smooth(9, seed), np.linspace(-0.6, 0.6, len(kinds) + 1)[1:-1])
    return np.choose(which, [ground(k, seed + i) for i, k in enumerate(kinds)])


ROWS, COLUMNS = np.mgrid[: SHAPE[0], : SHAPE[1]]
COAST = 70 + 12 * np.sin(ROWS / 17) > COLUMNS
RIVER = np.abs(COLUMNS - 100 - 40 * np.sin(ROWS / 40)) < 9
LAND = land_of(FOREST, SOIL, TOWN)
KINDS = {  # water, glint, sheet, land, where the land is
    "clear ocean": (CLEAR, 0.004, 0.0, LAND, COAST),
    "heavy glint": (CLEAR, 0.03, 0.08, LAND, COAST),
    "glint and haze over everything": ((0.10, 0.11, 0.09, 0.085), 0.02, 0.05, LAND + 0.08, COAST),
    "turbid river": (TURBID, 0.006, 0.0, LAND, ~RIVER),
    "brown river": (BROWN, 0.006, 0.0, land_of(FOREST, SOIL), ~RIVER),
    "salt lake": (BRINE, 0.005, 0.0, ground(CRUST, 2), COAST),
    "reservoir": ((0.03, 0.04, 0.03, 0.01), 0.002, 0.0, land_of(FOREST, SOIL), np.hypot(ROWS - 90, COLUMNS - 100) > 25),
    "forest coast": (TURBID, 0.02, 0.0, ground(FOREST, 4), COAST),
}


def made(kind):
    spectrum, glint, sheet, land, where = KINDS[kind]
    return np.where(where, land, water_of(spectrum, 1, glint, sheet)).astype(np.float32), ~where


@pytest.mark.parametrize("kind", KINDS)
def test_water_is_found_beside_land(kind):
    scene, truth = made(kind)
    found = water(scene, fit_water([scene], ROLES, pixel=10.0))
    assert (found & truth).sum() / (found | truth).sum() > (0.92 if kind == "heavy glint" else 0.97)
    assert found[truth].mean() > 0.98


@pytest.mark.parametrize("kind", KINDS)
def test_unit_offset_and_order_of_bands_do_not_matter(kind):
    """Whole numbers, so that nothing is rounded."""
    scene = np.rint(10_000 * made(kind)[0])
    expected = water(scene, fit_water([scene], ROLES, pixel=10.0))
    for other, roles in (
        (scene + 1000, ROLES), (scene - 5000, ROLES), (scene * 2.0**-14, ROLES),
        (scene[[3, 0, 2, 1]], Roles(nir=0, blue=1, red=2, green=3)),
    ):  # fmt: skip
        np.testing.assert_array_equal(water(other, fit_water([other], roles, pixel=10.0)), expected)


@pytest.mark.parametrize("kind", KINDS)
def test_tiles_are_the_whole(kind):
    scene, _ = made(kind)
    for pixel in (10.0, 1.0):
        rule = fit_water([scene], ROLES, pixel=pixel)
        np.testing.assert_array_equal(tiled(water, scene, rule, 64), water(scene, rule))


@pytest.mark.parametrize(("spectrum", "glint", "sheet"), [(k[0], k[1], k[2]) for k in KINDS.values()])
def test_without_land_all_is_water(spectrum, glint, sheet):
    scene = water_of(spectrum, 1, glint, sheet).astype(np.float32)
    rule = fit_water([scene], ROLES, pixel=10.0)
    if spectrum == BROWN:  # alone it might be a town: the message says what to do
        assert "--mask none" in rule.reason
    else:
        assert rule.water_fraction > 0.9995


def test_dark_land_of_unknown_colour_is_not_joined_to_the_water():
    dry, wet, green = (0.065, 0.052, 0.057, 0.04), (0.065, 0.055, 0.05, 0.04), (0.04, 0.05, 0.04, 0.15)
    rng = np.random.default_rng(6)
    which = rng.choice(3, SHAPE, p=[0.45, 0.1, 0.45])  # a fine mosaic: redder than white, like water, and plants
    land = (
        np.array([dry, wet, green])[which].transpose(2, 0, 1)
        * np.exp(rng.normal(0, 0.25, SHAPE))
        * np.exp(rng.normal(0, 0.02, (4, *SHAPE)))
    )
    truth = COLUMNS > 172
    scene = np.where(truth, water_of((0.094, 0.086, 0.063, 0.013), 1, 0.002), land).astype(np.float32)
    found = water(scene, fit_water([scene], ROLES, pixel=30.0))
    assert found[truth].mean() > 0.98
    assert found[~truth].mean() < 0.02


@pytest.mark.parametrize(
    "kinds", [(FOREST,), (SOIL,), (TOWN,), (FOREST, TOWN), (FOREST, SOIL, TOWN), (CRUST,), (CLOUD,)]
)
@pytest.mark.parametrize("offset", [0.0, 0.1])
def test_land_alone_is_no_water(kinds, offset):
    scene = (land_of(*kinds) + offset).astype(np.float32)
    rule = fit_water([scene], ROLES, pixel=10.0)
    assert not rule.has_water
    assert not water(scene, rule).any()
    assert all(word in rule.reason for word in ("--nir", "--mask none", "--mask FILE"))


SUN = (np.array([1950, 1830, 1560, 1040]) / 1830)[:, None, None]
PATH = np.array([0.06, 0.035, 0.02, 0.008])[:, None, None]


@pytest.mark.parametrize("kind", ["clear ocean", "heavy glint", "salt lake", "forest coast"])
@pytest.mark.parametrize("pixel", [10.0, 2.0])
def test_water_is_found_in_radiance_too(kind, pixel):
    """In radiance above the atmosphere towns and soil have less NIR than green, like water."""
    scene, truth = made(kind)
    scene = ((scene + PATH) * SUN).astype(np.float32)
    found = water(scene, fit_water([scene], ROLES, pixel=pixel))
    assert (found & truth).sum() / (found | truth).sum() > (0.92 if kind == "heavy glint" else 0.97)
    assert found[truth].mean() > 0.98


@pytest.mark.parametrize("kinds", [(FOREST,), (SOIL,), (TOWN,), (FOREST, SOIL, TOWN), (CRUST,), (CLOUD,)])
def test_land_alone_is_no_water_in_radiance_either(kinds):
    scene = ((land_of(*kinds) + PATH) * SUN).astype(np.float32)
    assert not fit_water([scene], ROLES, pixel=10.0).has_water


def test_ships_piers_and_clouds_are_no_water_and_a_reef_is():
    scene, covered = water_of(CLEAR, 3, 0.01).astype(np.float32), np.zeros(SHAPE, bool)
    covered[30:34, 40:52] = covered[90:93, 100:103] = covered[140:144, :60] = True
    covered |= np.hypot(ROWS - 60, COLUMNS - 150) < 25
    reef = (ROWS > 120) & (COLUMNS > 120)
    scene[:, reef] += np.array([0.08, 0.1, 0.03, 0.0], np.float32)[:, None]
    scene[:, covered] = np.array(CLOUD, np.float32)[:, None] * np.exp(smooth(1, 3, 0.1)[covered])
    found = water(scene, fit_water([scene], ROLES, pixel=10.0))
    assert not found[covered].any()
    assert found[~covered].mean() > 0.9999


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_clouds_are_no_water_however_much_there_is_of_them(share):
    scene, cloud = water_of(CLEAR, 3, 0.01), smooth(15, 9)
    cloud = cloud > np.quantile(cloud, 1 - share)
    white = np.array([0.5, 0.48, 0.47, 0.46])[:, None, None] * np.exp(smooth(4, 2, 0.2))
    scene = np.where(cloud, white, scene).astype(np.float32)
    found = water(scene, fit_water([scene], ROLES, pixel=10.0))
    assert found[~cloud].mean() > 0.999
    assert not found[cloud].any()


# -------------------------------------------------------------------------------------------------- real ports
PORTS = {  # least intersection over union, away from labelled ships
    "real/athens": 0.99, "real/klang": 0.985, "real/cartagena": 0.975, "real/gdynia": 0.99,
    "sentinel2/casablanca": 0.98, "sentinel2/honolulu": 0.97,
}  # fmt: skip


def port(name):
    rasterio = pytest.importorskip("rasterio")
    place = SHARED / name
    files = [place / f"{b}.tiff" for b in ("B02", "B03", "B04", "B08")] if place.is_dir() else [f"{place}.tif"]
    sides = (
        [place / "water.tif", place / "ships.tif"] if place.is_dir() else [f"{place}_water.tif", f"{place}_ships.tif"]
    )
    if not Path(files[0]).is_file():
        pytest.skip(f"{name} is not there")
    scene = np.concatenate([rasterio.open(f).read() for f in files])[:4].astype(np.float32)
    return scene, *(rasterio.open(f).read(1) > 0 for f in sides)


@pytest.mark.shared
@pytest.mark.parametrize("name", PORTS)
def test_real_ports_have_the_checked_mask_with_an_offset_too(name):
    scene, truth, ships = port(name)
    masks = [water(s, fit_water([s], ROLES, pixel=10.0)) for s in (scene, scene + 6554)]
    np.testing.assert_array_equal(*masks)
    found, truth = masks[0][~ships], truth[~ships]
    assert (found & truth).sum() / (found | truth).sum() > PORTS[name]


@pytest.mark.shared
def test_land_of_real_ports_alone_is_no_water():
    for name in PORTS:
        scene, truth, _ = port(name)
        for row in range(0, truth.shape[0] - 159, 160):
            for column in range(0, truth.shape[1] - 159, 160):
                part = slice(row, row + 160), slice(column, column + 160)
                if not truth[part].any():
                    assert not fit_water([scene[:, *part]], ROLES, pixel=10.0).has_water


@pytest.mark.shared
@pytest.mark.parametrize(
    ("name", "roles", "pixel", "share"),
    [
        ("real/micasense/aligned_0192", ROLES, None, 0.999),
        ("real/sdb/image", ROLES, 10.0, 0.99),
        ("sentinel2/wistari", Roles(blue=1, green=2, red=3, nir=7), 10.0, 0.999),
        ("wide/p124_w9_wv3", Roles(blue=1, green=2, red=4, nir=6), 1.24, 1.0),
        ("wide/into_glint_w9_60ms", Roles(blue=1, green=2, red=4, nir=6), 0.25, 1.0),
        ("wide/planetscope4_w9", ROLES, 3.0, 1.0),
    ],
)
def test_reefs_and_the_densest_glint_are_water(name, roles, pixel, share):
    """All but an island and surf of sdb is water."""
    rasterio = pytest.importorskip("rasterio")
    path = SHARED / f"{name}.tif"
    if not path.is_file():
        pytest.skip(f"{name} is not there")
    with rasterio.open(path) as data:
        scene = data.read().astype(np.float32) * np.array(data.scales, np.float32)[:, None, None]
    found = water(scene, fit_water([scene], roles, pixel=pixel))
    assert found.mean() >= share
    if "sdb" in name:
        assert found.mean() < 0.998


@pytest.mark.parametrize("mask", ["auto", "none"])
def test_all_of_a_small_sea_in_a_large_file_without_data_teaches(sea, write, tmp_path, mask):
    image = np.zeros((4, 1500, 1500), np.uint16)
    image[:, 100:356, 900:1156] = sea(256, 256)
    source = write(tmp_path / "in.tif", image, nodata=0)
    model = fit_scene(open_scene(source), Recipe(method="wiener", compensate="off", mask=mask)).model
    assert model.fits[0].n > 256**2 / 2
