"""Standard errors: as large as the errors are, local, and NaN where there is nothing to say."""

from dataclasses import replace

import numpy as np
import pytest

from deglint import Recipe, fit_scene, open_scene, remove_glint
from deglint.compensate import uncertainty as module
from deglint.compensate.trials import Trial
from deglint.compensate.uncertainty import BandError, Parts, Uncertainty, fit, stderr
from deglint.errors import FitError, InputError
from deglint.physics.presets import preset
from deglint.pipeline.correct import Correction
from deglint.pipeline.uncertain import MOVES, _looked, _sea, _trial, with_stderr
from deglint.raster.output import Layout
from deglint.raster.simulated import write_scene
from deglint.remove import GlintModel
from deglint.remove.model import BandFit, GlintIndex
from deglint.simulate import Setup, simulate
from deglint.tiles import Tile

MODEL = GlintModel("joyce", (GlintIndex((1,), (1.0,), 2.0),), (BandFit(0, "B", 0, 0.5, 0.1, 0.75),), ("B", "NIR"))
SIDE = 192


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """Two simulated seas, seeds that no constant was set on: their paths and truths."""
    folder, found = tmp_path_factory.mktemp("seas"), {}
    for name, wind, delay, seed in (("calm", 5.0, 0.06, 31), ("even", 6.0, 0.0, 32)):
        setup = Setup(
            sensor=preset("thesis").delayed(delay), size=(SIDE, SIDE), wind=wind, patch=0.005, sky="cardioidal",
            seed=seed,
        )  # fmt: skip
        scene = simulate(setup)
        write_scene(scene, folder / name)
        found[name] = folder / f"{name}.tif", scene.truth.astype(np.float64)
    return found


def correction(path, compensate="auto"):
    scene = open_scene(path)
    method = "joyce" if compensate == "off" else "auto"  # auto leaves this sea as it is without compensation
    fitted = fit_scene(scene, Recipe(mask="none", compensate=compensate, method=method), threads=1)
    layout = Layout(scene.source.info, tuple(range(len(scene.bands))), "float32", None, {})
    work = Correction(scene, fitted.model, False, False, layout, None, None, (), fitted.chain)
    whole = Tile(0, scene.height, 0, scene.width)
    return with_stderr(work, [whole], (), 1), whole


@pytest.fixture(scope="module")
def calm(simulated):
    return correction(simulated["calm"][0])


def ratio(error, claimed, where):
    """Root mean square of the errors over that of the standard errors."""
    return np.sqrt((error[where] ** 2).mean() / (claimed[where].astype(np.float64) ** 2).mean())


def test_clean_and_replaced_pixels_err_as_much_as_is_claimed(simulated, calm):
    work, whole = calm
    claimed = work(whole).stderr
    parts = replace(work, uncertainty=None)(whole).parts
    error = parts.after - simulated["calm"][1]
    assert parts.kept is None or parts.kept.mean() < 0.01
    for kind, where in (("clean", ~parts.replaced), ("replaced", parts.replaced)):
        assert where[:5].mean() > 0.05, kind
        assert 0.8 < ratio(error[:5], claimed[:5], where[:5]) < 1.25, kind
        assert 0.8 < ratio(error[5:], claimed[5:], where[5:]) < 1.25, kind
    normal = (error / claimed)[:5][~parts.replaced[:5]]
    assert 0.75 < np.diff(np.percentile(normal, [16, 84]))[0] / 2 < 1.25


def test_removal_alone_errs_as_much_as_is_claimed(simulated):
    path, truth = simulated["even"]
    work, whole = correction(path, "off")
    claimed, parts = work(whole).stderr, replace(work, uncertainty=None)(whole).parts
    for i, band in enumerate(work.changed):
        everywhere = np.ones((SIDE, SIDE), np.bool_)
        assert 0.75 < ratio(parts.after[band] - truth[band], claimed[i], everywhere) < 1.25, band


@pytest.mark.parametrize("kind", ["calm", "plain"])
def test_tiles_give_what_the_whole_gives(kind, calm, simulated):
    work, whole = calm if kind == "calm" else correction(simulated["calm"][0], "off")
    expected = work(whole).stderr
    found = np.full_like(expected, -1)
    for row in range(0, SIDE, 61):
        for column in range(0, SIDE, 100):
            tile = Tile(row, min(row + 61, SIDE), column, min(column + 100, SIDE))
            found[:, tile.row0 : tile.row1, tile.col0 : tile.col1] = work(tile).stderr
    np.testing.assert_array_equal(found, expected)


def looks(seed=0, shape=(40, 50), noise=0.2):
    """A flat level, and pixels about it with a known noise."""
    rng = np.random.default_rng(seed)
    level = np.full((2, *shape), 10.0, np.float32)
    after = (level + noise * rng.standard_normal(level.shape)).astype(np.float32)
    replaced = rng.random(level.shape) < 0.2
    after[replaced] = level[replaced]
    return Parts(after, after, np.ones(shape, np.bool_), replaced, None, level, level)


def test_every_pixel_is_what_its_parts_say():
    """Against loops over pixels in float64."""
    rng = np.random.default_rng(1)
    wide = rng.uniform(5, 15, (2, 12, 14)).astype(np.float32)
    inner = slice(2, 10), slice(3, 13)
    after = rng.uniform(5, 15, (2, 8, 10)).astype(np.float32)
    after[1, 2, 2] = np.nan
    where, replaced, kept = rng.random((8, 10)) < 0.9, rng.random((2, 8, 10)) < 0.4, rng.random((8, 10)) < 0.1
    parts = Parts(after, after, where, replaced, kept, wide, wide - np.float32(3), inner)
    error = BandError(0, 0.3, 0.02, 0.05, 1.5, edges=0.01, high=-0.3, left=0.4, index=0, slope_error=0.1)
    told = Uncertainty((error,), 1, 6.0, 2.0, 0.5)
    found = stderr(parts, told, steps=(0.6, 0.6))
    for r, c in np.ndindex(8, 10):
        level, shown = float(wide[0, r + 2, c + 3]) - 3, max(float(wide[1, r + 2, c + 3]) - 6.0, 0.0)
        near = wide[0, max(r - 1, 0) : r + 6, max(c, 0) : c + 7].astype(float)
        relief = max(float(np.float32(near.max() - near.min())) ** 2 - 1.5, 0)
        of_level = 0.05 + (0.01 + module.OF_RELIEF**2) * relief
        noise = 0.3 + 0.02 * float(after[0, r, c] if kept[r, c] else level)
        variance = noise + of_level if kept[r, c] else of_level if replaced[0, r, c] else noise
        if replaced[0, r, c] and not kept[r, c]:
            variance += module.OF_GIVEN * max(float(after[0, r, c]) - level, 0) ** 2
        left = 0.4 * np.sqrt(0.25 * shown**2 + 0.75 * max(shown - module.STANDS_OUT * 2.0, 0) ** 2)
        variance += (left - 0.3 * bool(replaced[0, r, c] and not kept[r, c])) ** 2
        variance += (0.1 * 3.0) ** 2 + 0.6**2 / 12
        assert found[0, r, c] == pytest.approx(np.sqrt(variance), rel=1e-5) if where[r, c] else np.isnan(found[0, r, c])


def trial(part, error):
    away = part.after - part.removed_level
    return Trial(error.astype(np.float32), part.replaced, part.where, part.removed_level, away)


def test_noise_is_the_clean_pixels_own_and_the_level_errs_as_in_trials():
    """Errors of trials: their mean is of one sign with that of the level, their variance grows as a second one's."""
    parts = [looks(seed) for seed in range(6)]
    rng = np.random.default_rng(7)
    trials = [trial(part, 0.3 * rng.standard_normal(part.level.shape) - 0.4) for part in parts]
    told = fit(parts, MODEL, [0], trials=trials, growth=1.5, reference=1, glint={0: 1.0, 1: 1.0})
    (band,) = told.bands
    assert band.fixed + 10 * band.growing == pytest.approx(0.2**2, rel=0.05)
    assert (band.level, band.edges) == (pytest.approx(1.5 * 0.3**2, rel=0.1), 0.0)
    assert band.high == pytest.approx(-0.4, abs=0.02)


def test_what_pixels_of_a_bright_thing_share_is_no_texture_of_water():
    """A plateau that has sunk in the opening lies evenly above its level; the water about it is without texture."""
    rng = np.random.default_rng(9)
    level = (10 + rng.normal(0, 0.05, (2, 120, 100))).astype(np.float32)
    level[:, 40:60, 40:60] += 30
    after = level + rng.normal(0, 0.2, level.shape).astype(np.float32)
    after[:, 40:60, 40:60] += 2
    replaced = rng.random(level.shape) < 0.2
    replaced[:, 40:60, 40:60] = False
    part = Parts(after, after, np.ones((120, 100), np.bool_), replaced, None, level, level)
    plain = replace(part, after=level + rng.normal(0, 0.2, level.shape).astype(np.float32))
    error = trial(plain, 0.1 * rng.standard_normal(level.shape))
    (band,) = fit([part], MODEL, [0], trials=[error], reference=1, glint={0: 1.0, 1: 1.0}).bands
    assert band.level == pytest.approx(0.1**2, rel=0.2)


def test_errors_grow_where_the_level_spans():
    """A trial that errs by a tenth of how far the level spans within reach, beyond what is usual."""
    rng = np.random.default_rng(8)
    level = np.cumsum(rng.exponential(1.0, (2, 80, 60)), axis=2).astype(np.float32)
    after = level + rng.normal(0, 0.2, level.shape).astype(np.float32)
    replaced = rng.random(level.shape) < 0.3
    part = Parts(after, after, np.ones((80, 60), np.bool_), replaced, None, level, level)
    squares = np.stack([module._span(band) for band in level]).astype(np.float64) ** 2
    usual = np.median(squares[0][~replaced[0]])
    error = 0.1 * np.sqrt(np.maximum(squares - usual, 0.0)) * rng.standard_normal(level.shape)
    (band,) = fit([part], MODEL, [0], trials=[trial(part, error)], reference=1, glint={0: 1.0, 1: 1.0}).bands
    assert band.relief == pytest.approx(usual)
    assert band.edges == pytest.approx(0.01, rel=0.1)
    assert band.level == pytest.approx(0.0, abs=0.001 * usual)


@pytest.mark.parametrize(("high", "sigma", "k"), [(0.0, 1.0, 1.5), (0.4, 1.0, 1.5), (-0.3, 2.0, 1.2)])
def test_a_level_that_lies_too_high_is_seen_in_what_lies_below_it(high, sigma, k):
    """Pixels without glint, less a level too high; those k deviations above it are not clean. Against numbers drawn."""
    drawn = np.random.default_rng(5).normal(-high, sigma, 400_000)
    rest = drawn[drawn < k * sigma]
    found = module._cut_off(rest) - rest.mean()
    assert found == pytest.approx(high, abs=0.1 * sigma + 0.25 * abs(high))
    assert module._cut_off(np.zeros(10)) == 0.0
    exact = np.random.default_rng(6).standard_normal(1_000_000)
    from scipy.stats import truncnorm

    assert module._cut_off(exact[exact < 1.5]) == pytest.approx(truncnorm.mean(-np.inf, 1.5), abs=0.01)


def test_a_trial_lays_sparkle_and_noise_elsewhere(calm, simulated):
    """The sea of a trial is the level and what stands above it; a second trial begins with what the first one found."""
    work, whole = calm
    sea = _sea(replace(work, uncertainty=None)(whole).parts)
    parts = replace(work, uncertainty=None)(whole).parts
    sea = sea.steady(sea.noise())
    found, again = _trial(work, sea, sea.noise(), MOVES[0])
    assert found.where.mean() > 0.9
    np.testing.assert_array_equal(again.replaced, found.replaced)
    moments = _looked(work, parts, MOVES[:1])[1]
    np.testing.assert_array_equal(moments[0], found.moments())
    assert 0.5 < np.median(moments[0, :, 2] / moments[1, :, 2]) < 2
    error = found.error[:, found.where]
    assert np.isfinite(error).all()
    truth = simulated["calm"][1]
    real, tried = [], []
    for b in range(5):  # beyond these glint that is left varies with the waves, which no trial shows
        level = np.median(truth[b])
        real.append(((parts.after[b] - truth[b]) / level)[parts.replaced[b]])
        tried.append(found.error[b][found.replaced[b] & found.where] / level)
    assert 0.6 < np.std(np.concatenate(tried)) / np.std(np.concatenate(real)) < 1.3


def test_line_is_found_and_never_below_zero():
    rng = np.random.default_rng(3)
    place = rng.uniform(0, 10, 40_000)
    fixed, growing = module._line(place, (2 + 0.5 * place) * rng.standard_normal(place.size) ** 2)
    assert (fixed, growing) == (pytest.approx(2, rel=0.1), pytest.approx(0.5, rel=0.1))
    falling = module._line(place, 12 - place)
    assert falling == (pytest.approx(7.0, rel=0.02), 0.0)
    assert module._line(place, 3 * np.maximum(place - 5, 0))[0] == 0.0
    assert module._line(np.full(500, 7.0), np.full(500, 4.0)) == (4.0, 0.0)
    assert module._line(np.zeros(500), np.zeros(500)) == (0.0, 0.0)


def test_whole_numbers_add_their_steps(sea, write, tmp_path):
    path = write(tmp_path / "in.tif", sea())
    for dtype in ("uint16", "float32"):
        recipe = Recipe(method="joyce", compensate="off", sample="all", mask="none")
        remove_glint(path, tmp_path / f"{dtype}.tif", recipe, stderr=tmp_path / f"{dtype}_se.tif", dtype=dtype)
    with_steps, without = (open_scene(tmp_path / f"{t}_se.tif").read() for t in ("uint16", "float32"))
    np.testing.assert_allclose(with_steps**2 - without**2, 1 / 12, rtol=0.02)


def test_nan_where_not_valid_and_known_elsewhere(tmp_path, sea, write, deglint, read):
    """From the command: nodata stays NaN; the error against the water itself is as claimed; the image is the same."""
    image = sea(dtype="float32", seed=5)
    image[:, 10:14, 20:25] = -1
    path = write(tmp_path / "in.tif", image, nodata=-1)
    options = ("--method", "joyce", "--sample", "all", "--mask", "none", "--compensate", "off", "-q")
    assert deglint("remove", path, tmp_path / "a.tif", *options, "--stderr", tmp_path / "se.tif").code == 0
    assert deglint("remove", path, tmp_path / "b.tif", *options).code == 0
    clean, claimed = read(tmp_path / "a.tif"), read(tmp_path / "se.tif")
    np.testing.assert_array_equal(clean, read(tmp_path / "b.tif"))
    assert claimed.shape == (3, 80, 100)
    assert claimed.dtype == np.float32
    hidden = np.zeros((80, 100), np.bool_)
    hidden[10:14, 20:25] = True
    np.testing.assert_array_equal(np.isnan(claimed), np.broadcast_to(hidden, claimed.shape))
    error = clean[:3] - np.median(clean[:3][:, ~hidden], axis=1)[:, None, None]
    assert 0.9 < ratio(error, claimed, np.broadcast_to(~hidden, error.shape)) < 1.1
    assert abs(np.median(clean[0][~hidden]) - 900.0) < 20


def test_files_say_whose_error_they_hold(simulated, tmp_path):
    path = simulated["calm"][0]
    done = remove_glint(path, tmp_path / "out.tif", Recipe(mask="none"), stderr=tmp_path / "se.tif")
    errors = open_scene(tmp_path / "se.tif")
    assert errors.names[0] == f"standard error of {open_scene(path).names[0]}"
    assert done.sidecar["uncertainty"]["reference"] == 6
    assert len(done.sidecar["uncertainty"]["bands"]) == len(errors.bands) == 8


@pytest.mark.parametrize(
    ("compensate", "why"),
    [("normalise, identify-median:5, replace-bands, median:5, remove", "replace-level"), ("identify-level:5", "level")],
)
def test_a_compensation_without_a_level_is_refused(simulated, tmp_path, compensate, why):
    with pytest.raises(InputError, match=why):
        remove_glint(
            simulated["calm"][0], tmp_path / "out.tif", Recipe(mask="none", compensate=compensate),
            stderr=tmp_path / "se.tif",
        )  # fmt: skip
    assert list(tmp_path.iterdir()) == []


def test_too_few_pixels():
    few = looks(shape=(10, 10))
    with pytest.raises(FitError, match="need 256"):
        fit([few], MODEL, [0], trials=[trial(few, few.level)], reference=1)
    with pytest.raises(FitError, match="need 256"):
        fit([Parts(few.after, few.after, few.where)], MODEL, [0])
    with pytest.raises(InputError, match="replace-level"):
        fit([replace(few, level=None)], MODEL, [0], reference=1)
    with pytest.raises(InputError, match="needs a trial"):
        fit([few], MODEL, [0], reference=1)


def test_one_band_and_gaps_in_the_level():
    part = looks()
    level = part.level.copy()
    level[:, 5:8, 5:8] = np.nan
    part = replace(part, level=level, removed_level=level, where=part.where & np.isfinite(level[0]))
    model = replace(MODEL, fits=(), indexes=())
    told = fit([part], model, [1], trials=[trial(part, 0 * part.level)], reference=1, glint={1: 1.0})
    found = stderr(part, told)
    assert found.shape == (1, 40, 50)
    assert np.array_equal(np.isnan(found[0]), ~part.where)


def test_standard_errors_do_not_depend_on_the_blocks_of_the_file(simulated, read, tmp_path, monkeypatch):
    """Trials are made of tiles of their own; tiles of the run follow the file's blocks."""
    import rasterio

    monkeypatch.setattr("deglint.tiles.COMPACT", 64)
    monkeypatch.setattr("deglint.tiles.HELD", 1 << 16)
    source, found = simulated["calm"][0], []
    for blocks in ({"tiled": True, "blockxsize": 64, "blockysize": 64}, {"tiled": False, "blockysize": 16},
                   {"tiled": True, "blockxsize": 96, "blockysize": 96}):  # fmt: skip
        path, out = tmp_path / f"{len(found)}.tif", tmp_path / f"e{len(found)}.tif"
        with rasterio.open(source) as a:
            profile = {k: v for k, v in a.profile.items() if "block" not in k and k != "tiled"}
            with rasterio.open(path, "w", **(profile | blocks)) as b:
                b.write(a.read())
                b.scales, b.descriptions = a.scales, a.descriptions
                b.update_tags(**a.tags())
                for i in a.indexes:
                    b.update_tags(i, **a.tags(i))
        remove_glint(path, tmp_path / f"o{len(found)}.tif", Recipe(mask="none"), stderr=out, threads=1)
        found.append(read(out))
    assert np.isfinite(found[0]).any()
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])
