"""Water and the deep-water sample: made-up seas with known truth, then real and simulated scenes."""

import json
import subprocess
import sys
import warnings

import numpy as np
import pytest

from deglint.errors import FitError
from deglint.masks import Roles, deep_water, fit_sample, fit_water, water
from deglint.remove.detrend import detrend

from .common import ROLES, SHARED


def open_water(shape=(200, 240), *, glint=0.004, noise=0.0006, seed=1):
    """Reflectance of open water at coarse pixels: waves of glint in all bands, noise in each."""
    rng = np.random.default_rng(seed)
    import cv2

    waves = cv2.GaussianBlur(rng.normal(size=shape), (0, 0), 1.5)
    waves = np.maximum(glint * (waves / waves.std() + 2), 0)
    level = np.array([0.05, 0.03, 0.015, 0.005])[:, None, None]
    slope = np.array([0.95, 0.9, 0.8, 1.0])[:, None, None]
    return (level + slope * waves + rng.normal(0, noise, (4, *shape))).astype(np.float32)


def sparkling_sea(shape=(256, 256), seed=2):
    """Metre-scale water: half of the pixels have glint, many times the water in some."""
    rng = np.random.default_rng(seed)
    glint = 0.05 * rng.lognormal(0, 1.5, shape) * (rng.random(shape) < 0.5)
    level = np.array([0.05, 0.03, 0.015, 0.005])[:, None, None]
    return np.clip(level + glint + rng.normal(0, 5e-4, (4, *shape)), 0, 0.8).astype(np.float32)


def put(scene, where, spectrum, texture=0.0, seed=3):
    """Paint a part of the scene with a spectrum."""
    rows, columns = np.nonzero(where)
    factor = np.random.default_rng(seed).lognormal(0, texture, rows.size) if texture else 1.0
    scene[:, rows, columns] = np.asarray(spectrum)[:, None] * factor


LAND = (0.06, 0.08, 0.09, 0.25)
CLOUD = (0.45, 0.44, 0.43, 0.44)
FOAM = (0.25, 0.25, 0.24, 0.2)
REEF = (0.14, 0.13, 0.05, 0.008)


@pytest.fixture
def coast():
    """Sea with land, a cloud, a line of foam, a submerged reef and three boats; the mask of each."""
    scene = open_water()
    rows, columns = np.mgrid[:200, :240]
    parts = {
        "land": columns < 40 + 5 * np.sin(rows / 9),
        "cloud": (rows - 40) ** 2 + (columns - 190) ** 2 < 20**2,
        "foam": (abs(rows - 150 - columns // 8) < 2) & (columns > 60) & (columns < 120),
        "reef": (rows > 160) & (columns > 150) & (columns < 230),
        "boats": np.zeros((200, 240), bool),
    }
    for r, c in ((20, 90), (70, 140), (110, 200)):
        parts["boats"][r : r + 3, c : c + 2] = True
    put(scene, parts["land"], LAND, 0.25)
    put(scene, parts["reef"], REEF, 0.2)
    for name, spectrum in (("cloud", CLOUD), ("foam", FOAM), ("boats", (0.2, 0.2, 0.2, 0.2))):
        put(scene, parts[name], spectrum)
    return scene, parts


def solid(parts):
    return parts["land"] | parts["cloud"] | parts["foam"] | parts["boats"]


# ------------------------------------------------------------------------------------------------ truth
def test_a_coast_is_distinguished_to_the_pixel(coast):
    scene, parts = coast
    rule = fit_water([scene], ROLES, pixel=10.0)
    np.testing.assert_array_equal(water(scene, rule), ~solid(parts))
    assert rule.window == 1
    assert not rule.all_water
    assert rule.water_fraction == pytest.approx((~solid(parts)).mean())


def test_the_sample_is_deep_water_away_from_everything(coast):
    scene, parts = coast
    import cv2

    rule = fit_sample([scene], fit_water([scene], ROLES, pixel=10.0))
    sample = deep_water(scene, rule)
    near = cv2.dilate((solid(parts) | parts["reef"]).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    assert rule.pixels == sample.sum() > 2000
    assert not (sample & near).any()
    assert rule.r_squared > 0.8
    assert rule.glint == pytest.approx(0.004, rel=0.3)


def test_slopes_over_the_sample_are_those_of_the_glint(coast):
    scene, _ = coast
    sample = deep_water(scene, fit_sample([scene], fit_water([scene], ROLES, pixel=10.0)))
    np.testing.assert_allclose(slopes(scene, sample, ROLES), [0.95, 0.9, 0.8], rtol=0.04)


@pytest.mark.parametrize("seed", range(5))
def test_a_coast_under_any_waves(seed):
    scene = open_water(seed=seed, glint=0.002 + 0.002 * seed)
    land = np.indices((200, 240))[1] < 60 + 10 * seed
    put(scene, land, LAND, 0.25, seed=seed)
    found = water(scene, fit_water([scene], ROLES, pixel=10.0))
    assert not found[land].any()
    assert found[~land].mean() > 0.9997  # the brightest crests may be lost


def test_land_is_distinguished_by_the_valley_where_bands_are_not_calibrated():
    scene = open_water(glint=0.02)
    land = np.arange(240) < 80
    put(scene, np.broadcast_to(land, (200, 240)), LAND, texture=0.2)
    scene[3] *= 1.4  # over much of the water the NIR is then brighter than the visible
    assert (scene[3] > scene[1])[:, ~land].mean() > 0.3
    rule = fit_water([scene], ROLES, pixel=10.0)
    assert (water(scene, rule) == ~land).mean() > 0.995


def test_tiles_of_a_swath_with_more_and_more_glint_are_all_water():
    """Each tile has its own narrow peak of brightness; none of them is land. Land in one of them is."""
    looks = []
    for i, glint in enumerate((0.0, 0.01, 0.025, 0.04)):
        tile = open_water((128, 128), seed=i, glint=0.1 * glint)
        tile += glint * np.array([0.95, 0.9, 0.8, 1.0], np.float32)[:, None, None]
        looks.append(tile)
    land = np.indices((128, 128))[0] > 90
    put(looks[1], land, LAND, 0.2)
    rule = fit_water(looks, ROLES, pixel=10.0)
    for i, tile in enumerate(looks):
        expected = ~land if i == 1 else np.ones_like(land)
        assert (water(tile, rule) == expected).mean() > 0.999


def test_a_grey_town_in_radiance_is_not_water():
    """Its NIR is darker than its green there, but red is not."""
    town = np.array([0.9, 1.0, 1.02, 0.8])[:, None, None] * np.ones((4, 90, 90))
    town *= np.random.default_rng(1).lognormal(0, 0.3, (90, 90))
    assert not fit_water([town], ROLES).has_water


def nearly_equal(kind):
    rng = np.random.default_rng(0)
    if kind == "clouds":
        return (0.2 + rng.normal(0, 0.01, (4, 250, 250))).astype(np.float32)
    if kind == "steps":
        return (1e7 + rng.integers(0, 4, (4, 100, 100))).astype(np.float32)
    return np.stack([np.full((100, 100), v, np.float32) for v in (4e7, 4e7, 4e7, 3e7)])


@pytest.mark.parametrize("kind", ["clouds", "steps", "even"])
def test_numbers_that_differ_by_a_few_steps_of_float32_are_looked_at(kind):
    rule = fit_water([nearly_equal(kind)], ROLES)
    assert rule.pixels == nearly_equal(kind)[0].size


def test_all_water_and_no_water():
    assert fit_water([open_water()], ROLES, pixel=10.0).all_water
    land = open_water()
    put(land, np.ones(land.shape[1:], bool), LAND, 0.3)
    rule = fit_water([land], ROLES)
    assert not rule.has_water
    assert not water(land, rule).any()
    assert "--mask" in rule.reason
    with pytest.raises(FitError, match="no water"):
        fit_sample([land], rule)


@pytest.mark.parametrize("roles", [Roles(nir=3, green=1), Roles(nir=3, blue=0), Roles(nir=3, red=2)])
def test_one_visible_band_will_do(coast, roles):
    scene, parts = coast
    rule = fit_water([scene], roles, pixel=10.0)
    assert (water(scene, rule) != ~solid(parts)).mean() < 0.002
    assert deep_water(scene, fit_sample([scene], rule)).sum() > 2000


# ------------------------------------------------------------------------------------------- invariants
@pytest.mark.parametrize("factor", [2.0**-20, 2.0**14, 10_000.0])
def test_the_unit_does_not_matter(coast, factor):
    scene, _ = coast
    scaled = scene * np.float32(factor)
    rules = [fit_water([s], ROLES, pixel=10.0) for s in (scene, scaled)]
    np.testing.assert_array_equal(*(water(s, r) for s, r in zip((scene, scaled), rules, strict=True)))
    a, b = (deep_water(s, fit_sample([s], r)) for s, r in zip((scene, scaled), rules, strict=True))
    assert (a != b).mean() < (1e-3 if factor == 10_000.0 else 0.0) + 1e-12


def tiled(function, scene, rule, size=50):
    """The mask put together from tiles that carry a halo inside the image only."""
    rows, columns = scene.shape[1:]
    out = np.zeros((rows, columns), bool)
    for r in range(0, rows, size):
        for c in range(0, columns, size):
            top, left = max(r - rule.halo, 0), max(c - rule.halo, 0)
            block = scene[:, top : r + size + rule.halo, left : c + size + rule.halo]
            out[r : r + size, c : c + size] = function(block, rule)[r - top :, c - left :][:size, :size]
    return out


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_tiles_are_the_whole(coast, dtype):
    scene = coast[0].astype(dtype)
    scene[:, 90:100, 60:130] = np.nan
    rule = fit_water([scene], ROLES, pixel=10.0)
    np.testing.assert_array_equal(tiled(water, scene, rule), water(scene, rule))
    sample = fit_sample([scene], rule)
    np.testing.assert_array_equal(tiled(deep_water, scene, sample), deep_water(scene, sample))


def test_tiles_are_the_whole_under_sparkle():
    scene = sparkling_sea()
    put(scene, np.indices((256, 256)).sum(0) < 150, LAND, 0.2)
    scene[:, 120:140, 30:200] = np.nan
    rule = fit_water([scene], ROLES, pixel=0.5)
    assert rule.halo > 0
    np.testing.assert_array_equal(tiled(water, scene, rule), water(scene, rule))
    sample = fit_sample([scene], rule)
    np.testing.assert_array_equal(tiled(deep_water, scene, sample), deep_water(scene, sample))


def test_nan_is_never_true_and_input_is_left_alone(coast):
    scene, parts = coast
    scene[3, 100:, :] = np.nan
    scene[0, :50, 100:] = np.nan
    before = scene.copy()
    rule = fit_water([scene], ROLES, pixel=10.0)
    sample = fit_sample([scene], rule)
    invalid = ~np.isfinite(scene[:4]).all(axis=0)
    for mask in (water(scene, rule), deep_water(scene, sample)):
        assert mask.dtype == bool
        assert not mask[invalid].any()
    assert (water(scene, rule) != (~solid(parts) & ~invalid)).sum() <= 1
    np.testing.assert_array_equal(scene, before)


def test_tiles_of_the_scene_will_do_for_a_look(coast):
    scene, parts = coast
    looks = [scene[:, r : r + 64, c : c + 64] for r in (0, 100) for c in (0, 90, 170)]
    assert (water(scene, fit_water(looks, ROLES, pixel=10.0)) != ~solid(parts)).sum() <= 1


def test_rules_are_plain_numbers(coast):
    rule = fit_water([coast[0]], ROLES, pixel=10.0)
    sample = fit_sample([coast[0]], rule)
    assert json.loads(json.dumps(rule.numbers()))["roles"]["nir"] == 3
    assert json.loads(json.dumps(sample.numbers()))["pixels"] == sample.pixels
    assert "examined are water" in rule.reason


# ------------------------------------------------------------------------------------------ hard inputs
def hard_inputs():
    quantised = np.round(open_water() * 400)
    clipped = np.maximum(open_water() - np.array([0, 0, 0, 0.015], np.float32)[:, None, None], 0)
    half = open_water()
    half[:, :, 120:] = np.nan
    dotted = open_water()
    dotted[:, ::7, ::7] = np.nan
    return {
        "all NaN": np.full((4, 64, 64), np.nan, np.float32),
        "zero": np.zeros((4, 64, 64), np.float32),
        "negative": open_water((64, 64)) - 1,
        "constant": np.full((4, 64, 64), 0.02, np.float32),
        "constant water": np.ones((4, 64, 64)) * np.array([0.05, 0.03, 0.02, 0.005])[:, None, None],
        "one pixel": open_water((4, 4))[:, :1, :1],
        "one row": open_water((1, 300)),
        "tiny": open_water((9, 9)),
        "64 x 64": open_water((64, 64)),
        "half nodata": half,
        "dotted nodata": dotted,
        "8 bit": quantised,
        "NIR floor": clipped,
        "huge offset": open_water().astype(np.float64) + 1e6,
        "empty": np.zeros((4, 0, 10), np.float32),
        "infinite": np.where(open_water() > 0.06, np.inf, open_water()),
        "cloud": np.full((4, 64, 64), 0.6) + np.random.default_rng(1).normal(0, 0.05, (4, 64, 64)),
    }


OUTCOME = {
    "all NaN": "no valid pixel",
    "zero": "no water",
    "constant": "no water",
    "constant water": "NIR is 0.005 all over",
    "one pixel": "NIR is .* all over",
    "one row": "no 15 x 15 square",
    "tiny": "no 15 x 15 square",
    "empty": "no valid pixel",
    "cloud": "no water",
}


@pytest.mark.parametrize("name", hard_inputs())
def test_hard_inputs_give_a_sample_or_say_why_not(name):
    scene = hard_inputs()[name]
    rule = fit_water([scene], ROLES, pixel=10.0)
    mask = water(scene, rule)
    assert mask.shape == scene.shape[1:]
    if name in OUTCOME:
        with pytest.raises(FitError, match=OUTCOME[name]) as error:
            fit_sample([scene], rule)
        assert any(remedy in str(error.value) for remedy in ("Pass --", "--mask", "--nodata"))
    else:
        assert rule.water_fraction > 0.99
        assert deep_water(scene, fit_sample([scene], rule)).sum() >= 500


def test_blocks_without_pixels_or_water_are_passed_over(coast):
    scene, parts = coast
    looks = [scene, scene[:, :0], scene[:, :30, :20], np.full((4, 20, 20), np.nan)]
    rule = fit_water(looks, ROLES, pixel=10.0)
    np.testing.assert_array_equal(water(scene, rule), ~solid(parts))
    sample = fit_sample(looks, rule)
    for block in looks[1:]:
        assert not deep_water(block, sample).any()


def test_import_is_cheap():
    code = "import sys, deglint.masks; print([m for m in ('scipy', 'numba') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# --------------------------------------------------------------------------------------- the shared scenes
REAL = {
    "casablanca": ROLES,
    "honolulu": ROLES,
    "palau": Roles(blue=1, green=2, red=3, nir=7),
    "wistari": Roles(blue=1, green=2, red=3, nir=7),
}
WORLDVIEW = Roles(blue=1, green=2, red=4, nir=6)
SIMULATED = (
    "wind02_delay60",
    "wind05_delay60",
    "wind09_delay00",
    "wind09_delay60",
    "wind09_delay60_f30",
    "wind12_delay60_sun30",
)


def load(folder, name):
    path = SHARED / folder / f"{name}.tif"
    if not path.is_file():
        pytest.skip(f"{folder}/{name}.tif is not there")
    rasterio = pytest.importorskip("rasterio")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with rasterio.open(path) as source:
            scale = np.array(source.scales, np.float32)[:, None, None]
            return source.read().astype(np.float32) * scale


def slopes(scene, sample, roles):
    """Of blue, green and red on the NIR, a 15 x 15 mean taken off."""
    y = detrend(scene[[roles.blue, roles.green, roles.red, roles.nir]], sample)[:, sample]
    return (y[:3] @ y[3]) / (y[3] @ y[3])


@pytest.mark.shared
@pytest.mark.parametrize("pixel", [0.25, None])
@pytest.mark.parametrize("name", SIMULATED)
def test_simulated_sparkle_is_water(name, pixel):
    scene = load("simulated", name)
    assert water(scene, fit_water([scene], WORLDVIEW, pixel=pixel)).mean() > 0.99


@pytest.mark.shared
@pytest.mark.parametrize("pixel", [0.25, None])
@pytest.mark.parametrize("name", SIMULATED)
def test_land_stays_land_beside_simulated_sparkle(name, pixel):
    scene = load("simulated", name)
    land = np.zeros(scene.shape[1:], bool)
    land[:150, :200] = True
    spectrum = np.array([0.06, 0.07, 0.09, 0.1, 0.1, 0.25, 0.35, 0.35])
    sun = np.array([1700, 1950, 1830, 1700, 1560, 1350, 1040, 850]) / 1830 * 0.35
    put(scene, land, spectrum * sun, 0.3)
    found = water(scene, fit_water([scene], WORLDVIEW, pixel=pixel))
    assert found[land].mean() < 0.01
    assert found[~land].mean() > 0.99


@pytest.mark.shared
@pytest.mark.parametrize(
    ("name", "share"), [("casablanca", 0.57), ("honolulu", 0.44), ("palau", 0.99), ("wistari", 1.0)]
)
def test_share_of_water_in_real_scenes(name, share):
    """Shares that belong to masks judged by eye: ports, piers, ships and surf out, reef and harbours in."""
    scene = load("sentinel2", name)
    rule = fit_water([scene], REAL[name], pixel=10.0)
    mask = water(scene, rule)
    assert mask.mean() == pytest.approx(share, abs=0.01)
    np.testing.assert_array_equal(tiled(water, scene, rule, 128), mask)


@pytest.mark.shared
@pytest.mark.parametrize("name", ["casablanca", "honolulu"])
def test_ships_are_partly_out(name):
    scene, ships = load("sentinel2", name), load("sentinel2", f"{name}_ships")[0]
    out = ~water(scene, fit_water([scene], REAL[name], pixel=10.0))
    shares = [out[ships == i].mean() for i in np.unique(ships) if i]
    assert min(shares) > 0.1
    assert np.median(shares) > 0.6


@pytest.mark.shared
def test_palau_marks_surf_and_keeps_reef():
    scene = load("sentinel2", "palau")
    mask = water(scene, fit_water([scene], REAL["palau"], pixel=10.0))
    assert not mask[scene[7] > 1200].any()
    assert mask[240:270, 450:570].mean() > 0.97  # reef flat behind the surf
    assert mask[:150, :400].all()


@pytest.mark.shared
def test_palau_slopes_agree_with_the_hand_drawn_sample():
    """The polygon's ordinary slopes and spreads are those of independent software."""
    scene, roles = load("sentinel2", "palau"), REAL["palau"]
    rule = fit_sample([scene], fit_water([scene], roles, pixel=10.0))
    sample = deep_water(scene, rule)
    found = slopes(scene, sample, roles)
    np.testing.assert_allclose(found, [0.856348, 0.869187, 0.806518], rtol=0.07)
    assert sample.sum() > 10_000
    assert sample[200:].mean() < 0.001  # no plume, no reef
    polygon = scene[:, 25:100, 180:340].astype(np.float64)
    spread = [(polygon[b] - s * polygon[7]).std() for b, s in zip((1, 2, 3), found, strict=True)]
    np.testing.assert_array_less(spread, 1.02 * np.array([13.45, 12.72, 19.30]))


@pytest.mark.shared
@pytest.mark.parametrize("size", [120, 160, 200])
def test_palau_slopes_hardly_depend_on_the_look(size):
    scene, roles = load("sentinel2", "palau"), REAL["palau"]
    looks = [scene[:, r : r + size, c : c + size] for r in (0, 200) for c in (0, 200, 400)]
    sample = deep_water(scene, fit_sample(looks, fit_water(looks, roles)))
    np.testing.assert_allclose(slopes(scene, sample, roles), [0.856348, 0.869187, 0.806518], rtol=0.08)


@pytest.mark.shared
def test_simulated_slopes_without_delay():
    """Deep water is in columns 0-183; ordinary slopes there, over all of it, are 1.873, 1.825, 1.571."""
    scene = load("simulated", "wind09_delay00")
    rule = fit_sample([scene], fit_water([scene], WORLDVIEW))
    found = slopes(scene, deep_water(scene, rule), WORLDVIEW)
    np.testing.assert_allclose(found, [1.873, 1.825, 1.571], rtol=0.03)
    assert rule.r_squared > 0.95


@pytest.mark.shared
def test_calm_and_delayed_scenes_are_known_by_r_squared():
    calm, waves = load("sentinel2", "honolulu"), load("sentinel2", "casablanca")
    assert fit_sample([calm], fit_water([calm], REAL["honolulu"], pixel=10.0)).r_squared < 0.2
    assert fit_sample([waves], fit_water([waves], REAL["casablanca"], pixel=10.0)).r_squared > 0.7
    delayed = load("simulated", "wind09_delay60")
    assert fit_sample([delayed], fit_water([delayed], WORLDVIEW)).r_squared < 0.2


@pytest.mark.shared
@pytest.mark.parametrize("name", REAL)
def test_sample_of_real_scenes(name):
    scene = load("sentinel2", name)
    rule = fit_sample([scene], fit_water([scene], REAL[name], pixel=10.0))
    sample = deep_water(scene, rule)
    assert rule.pixels == sample.sum() >= 2000
    assert rule.share == pytest.approx(sample.mean())
    assert water(scene, rule.water)[sample].all()
    np.testing.assert_array_equal(tiled(deep_water, scene, rule, 128), sample)


def test_land_that_the_looks_have_missed_is_land():
    """A part of the scene may be all water: then the threshold holds beyond it, too."""
    scene = open_water()
    put(scene, np.indices((200, 240))[1] > 200, LAND, 0.2)
    rule = fit_water([scene[:, :, :120]], ROLES, pixel=10.0, whole=False)
    assert rule.water_fraction == 1.0
    assert not rule.all_water
    found = water(scene, rule)
    assert not found[:, 201:].any()
    assert found[:, :201].mean() > 0.9999


@pytest.mark.parametrize("step", [0.002, 0.005])
def test_coarse_integers_do_not_cut_the_water(step):
    scene = np.round(open_water(glint=0.002) / step)
    assert fit_water([scene], ROLES, pixel=10.0).water_fraction > 0.999
    put(scene, np.indices((200, 240))[1] > 200, np.array(LAND) / step, 0.2)
    found = water(scene, fit_water([scene], ROLES, pixel=10.0))
    assert not found[:, 201:].any()
    assert found[:, :201].mean() > 0.999
