"""Every removal method: exact where theory says so, the same for every tiling, and true to published values."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deglint import remove
from deglint.errors import BandError, FitError, InputError
from deglint.remove import METHODS, REGRESSIONS, GlintModel
from deglint.remove.levels import mode
from deglint.remove.statistics import gather, merge
from deglint.scene import Band

from .common import NARROW, SHARED, beside

# Narrow bands, so that every method of the table finds what it needs; the NIR reference is the last.
BANDS = tuple(Band(f"L{w}", float(w)) for w in NARROW)
NIR = 7
CORRECT = (0, 1, 2)
SLOPES = np.array([1.1, 1.0, 0.9, 0.5, 0.3, 0.5, 0.6, 1.0])
WATER = np.array([90.0, 70.0, 40.0, 10.0, 10.0, 10.0, 10.0, 8.0])

FITTED = [name for name, method in METHODS.items() if method.plan is not None]
REGRESSED = [name for name, method in METHODS.items() if "regression" in method.options]
COMBINATIONS = [
    (name, regression) for name in METHODS for regression in (REGRESSIONS if name in REGRESSED else ["ols"])
]


def scene(shape=(70, 90), noise=0.0, seed=0, dtype=np.float64):
    """Water of one colour with glint that adds SLOPES times itself to the bands."""
    rng = np.random.default_rng(seed)
    glint = np.round(rng.gamma(1.0, 20.0, shape), 3)
    glint[rng.random(shape) < 0.7] = 0
    block = WATER[:, None, None] + SLOPES[:, None, None] * glint + noise * rng.normal(size=(8, *shape))
    return block.astype(dtype), glint


def fitted(name, block, regression="ols", **options):
    return remove.fit(name, block, nir=NIR, bands=BANDS, regression=regression, correct=CORRECT, **options)


@pytest.mark.parametrize("regression", REGRESSIONS)
@pytest.mark.parametrize("name", REGRESSED)
def test_exact_on_linear_glint(name, regression):
    block, _ = scene()
    model = fitted(name, block, regression)
    assert [f.slope for f in model.fits] == pytest.approx(SLOPES[list(CORRECT)], rel=1e-6)
    assert [f.r2 for f in model.fits] == pytest.approx([1, 1, 1], abs=1e-9)
    out = remove.apply(block, model)
    level = block[NIR].mean() if name == "lyzenga" else WATER[NIR]
    assert model.indexes[0].level == pytest.approx(level, rel=1e-12 if name != "joyce" else 0.05)
    expected = WATER[:3] + SLOPES[:3] * (model.indexes[0].level - WATER[NIR])
    np.testing.assert_allclose(out[:3], np.broadcast_to(expected[:, None, None], out[:3].shape), rtol=1e-5)
    np.testing.assert_array_equal(out[3:], block[3:])


def test_hochberg_and_kutser_are_exact_on_linear_glint():
    block, _ = scene()
    for name in ("hochberg", "kutser"):
        out = remove.apply(block, fitted(name, block))
        np.testing.assert_allclose(out[:3], np.broadcast_to(WATER[:3, None, None], out[:3].shape), rtol=1e-12)


def test_goodman_and_nir_subtraction_follow_their_formulas():
    rng = np.random.default_rng(1)
    rrs = rng.uniform(0, 0.02, (8, 5, 6))
    out = remove.apply(rrs, fitted("goodman", rrs, rrs_factor=1.0))
    r640, r750 = rrs[2], rrs[6]
    np.testing.assert_allclose(out[:3], rrs[:3] - r750 + 0.000019 + 0.1 * (r640 - r750), rtol=1e-12, atol=1e-17)
    out = remove.apply(rrs, fitted("nir-subtraction", rrs))
    np.testing.assert_allclose(out[:3], rrs[:3] - rrs[NIR], rtol=1e-12)
    # reflectance is pi times Rrs, and so is the result
    scaled = remove.apply(math.pi * rrs, fitted("goodman", rrs))
    expected = math.pi * remove.apply(rrs, fitted("goodman", rrs, rrs_factor=1.0))
    np.testing.assert_allclose(scaled, expected, rtol=1e-10, atol=1e-15)


@pytest.mark.parametrize("name", REGRESSED)
def test_zero_glint_is_identity(name):
    block, _ = scene(noise=1.0)
    model = fitted(name, block)
    clean = block.copy()
    clean[NIR] = model.indexes[0].level
    np.testing.assert_array_equal(remove.apply(clean, model), clean)


@pytest.mark.parametrize(("name", "regression"), COMBINATIONS)
def test_order_of_bands_does_not_matter(name, regression):
    block, _ = scene(noise=1.0)
    order = np.random.default_rng(3).permutation(8)
    model = fitted(name, block, regression)
    place = {int(b): i for i, b in enumerate(order)}
    shuffled = remove.fit(
        name, block[order], nir=place[NIR], bands=[BANDS[b] for b in order], regression=regression,
        correct=[place[b] for b in CORRECT],
    )  # fmt: skip
    np.testing.assert_allclose(remove.apply(block[order], shuffled), remove.apply(block, model)[order], rtol=1e-9)
    # a saved model finds its bands by name
    moved = model.for_bands(tuple(BANDS[b].name for b in order))
    np.testing.assert_allclose(remove.apply(block[order], moved), remove.apply(block, model)[order], rtol=1e-14)


@pytest.mark.parametrize(("name", "regression"), COMBINATIONS)
def test_units_do_not_matter(name, regression):
    block, _ = scene(noise=1.0)
    out = remove.apply(block, fitted(name, block, regression, rrs_factor=1.0))
    for scale in (1e-6, 0.37, 1e6):
        scaled = remove.apply(block * scale, fitted(name, block * scale, regression, rrs_factor=scale))
        np.testing.assert_allclose(scaled / scale, out, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("name", "regression"), [c for c in COMBINATIONS if not METHODS[c[0]].neighbours])
def test_nan_stays_nan_and_never_enters_a_statistic(name, regression):
    block, _ = scene(noise=1.0)
    holes = np.random.default_rng(5).random(block.shape[1:]) < 0.2
    dirty = block.copy()
    dirty[1, holes] = np.nan
    before = dirty.copy()
    model = fitted(name, dirty, regression)
    without = fitted(name, block, regression, sample=~holes)
    assert [f.slope for f in model.fits] == [f.slope for f in without.fits]
    assert model.indexes == without.indexes
    out = remove.apply(dirty, model)
    np.testing.assert_array_equal(np.isnan(out[1]), holes)
    assert not np.isnan(out[[0, 2]]).any()
    np.testing.assert_array_equal(dirty, before)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", [name for name, method in METHODS.items() if not method.neighbours])
def test_apply_against_numpy(name, dtype):
    block, _ = scene(noise=1.0, dtype=dtype)
    model = fitted(name, block)
    expected = block.copy()
    for fit in model.fits:
        index = model.indexes[fit.index]
        g = sum(w * block[b].astype(float) for w, b in zip(index.weights, index.bands, strict=True)) - index.level
        expected[fit.band] = (block[fit.band].astype(float) - fit.slope * g).astype(dtype)
    out = remove.apply(block, model)
    assert out.dtype == dtype
    np.testing.assert_array_equal(out, expected)
    where = np.random.default_rng(6).random(block.shape[1:]) < 0.5
    np.testing.assert_array_equal(remove.apply(block, model, where=where), np.where(where, expected, block))
    inplace = block.copy()
    assert remove.apply(inplace, model, out=inplace) is inplace
    np.testing.assert_array_equal(inplace, expected)


@pytest.mark.parametrize(("name", "regression"), [c for c in COMBINATIONS if c[0] in FITTED])
def test_tiles_are_the_whole_to_the_bit(name, regression):
    block, _ = scene(shape=(200, 190), noise=1.0, dtype=np.float32)
    sample = np.random.default_rng(7).random(block.shape[1:]) < 0.6
    model = fitted(name, block, regression, sample=sample)
    request = remove.nir_request(BANDS, [NIR], correct=CORRECT, regression=regression)
    plan = METHODS[name].plan(request)
    read = block[list(plan.read_bands)]
    parts = []
    for r0, r1 in [(128, 200), (0, 64), (64, 128)]:
        for c0, c1 in [(64, 190), (0, 64)]:
            top, left = max(r0 - plan.halo, 0), max(c0 - plan.halo, 0)
            bottom, right = min(r1 + plan.halo, 200), min(c1 + plan.halo, 190)
            parts.append(
                gather(
                    read[:, top:bottom, left:right], sample[top:bottom, left:right], plan,
                    origin=(r0, c0), crop=(r0 - top, bottom - r1, c0 - left, right - c1),
                )
            )  # fmt: skip
    assert METHODS[name].fit(request, merge(parts, plan)) == model
    out = remove.apply(block, model)
    tiled = np.concatenate([remove.apply(block[:, :77], model), remove.apply(block[:, 77:], model)], axis=1)
    np.testing.assert_array_equal(tiled, out)


def test_standard_errors_are_honest():
    """Slopes of independent draws scatter as their standard errors say, with correlated residuals too."""
    import cv2

    slopes, claimed = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        smooth = cv2.GaussianBlur(rng.normal(size=(2, 256, 256)).transpose(1, 2, 0), (0, 0), 3).transpose(2, 0, 1)
        nir = 10 + 40 * smooth[0]
        model = remove.fit("lyzenga", np.stack([5 + 0.8 * nir + 20 * smooth[1], nir]), nir=1)
        slopes.append(model.fits[0].slope)
        claimed.append(model.fits[0].stderr)
    # the scatter of 60 draws is itself known to 1 / sqrt(2 * 59) = 9 %; three times that, and 4 cells a side
    assert np.mean(claimed) == pytest.approx(np.std(slopes, ddof=1), rel=0.3)
    assert np.mean(slopes) == pytest.approx(0.8, abs=4 * np.std(slopes) / np.sqrt(60))


def clumped(seed, cells=4):
    """A sea whose glint is mostly in a few cells, each with its own slope."""
    rng = np.random.default_rng(seed)
    bright = np.kron(rng.pareto(1.5, (cells, cells)), np.ones((64, 64)))
    nir = bright * rng.exponential(1.0, bright.shape)
    return np.stack([(0.8 + np.kron(rng.normal(0, 0.1, (cells, cells)), np.ones((64, 64)))) * nir, nir])


def test_standard_error_is_the_jackknife_over_cells():
    """Slopes without each cell in turn, over pixels, about the mean of all."""
    block = clumped(3)
    fitted = remove.fit("lyzenga", block, nir=1).fits[0]
    y, x = (band - band.mean() for band in block)
    cross, power = ((x * v).reshape(4, 64, 4, 64).sum(axis=(1, 3)).ravel() for v in (y, x))
    without = (cross.sum() - cross) / (power.sum() - power)
    assert fitted.slope == pytest.approx(cross.sum() / power.sum(), rel=1e-12)
    assert fitted.stderr == pytest.approx(np.sqrt(15 / 16 * ((without - fitted.slope) ** 2).sum()), rel=1e-9)


def test_standard_errors_are_honest_where_few_cells_hold_the_glint():
    """Root mean squares over draws; without leverages 0.4 of the scatter is claimed."""
    fits = [remove.fit("lyzenga", clumped(seed), nir=1).fits[0] for seed in range(200)]
    real = np.sqrt(np.mean([(fit.slope - 0.8) ** 2 for fit in fits]))
    claimed = np.sqrt(np.mean([fit.stderr**2 for fit in fits]))
    assert 0.8 < claimed / real < 1.6


def test_one_cell_with_all_the_glint_has_a_finite_error():
    block = np.random.default_rng(0).normal(5, 1e-9, (2, 256, 256))
    block[:, :64, :64] += np.random.default_rng(1).exponential(9.0, (64, 64))
    fitted = remove.fit("lyzenga", block, nir=1).fits[0]
    assert np.isfinite(fitted.stderr)


@pytest.mark.parametrize("kind", ["float", "integer", "scaled integer"])
def test_mode_converges_and_is_equivariant(kind):
    errors = []
    for n in (300, 3_000, 30_000, 300_000):
        draws = []
        for seed in range(5):
            values = np.random.default_rng(seed).gamma(5.0, 20.0, n)  # mode (5 - 1) * 20 = 80
            if kind != "float":
                values = np.round(values)
            draws.append(mode(values if kind != "scaled integer" else values * 1e-4) * (1e4 if "scaled" in kind else 1))
        errors.append(np.sqrt(np.mean((np.array(draws) - 80) ** 2)))
    assert errors[-1] < 1.5  # 1.5 of a standard deviation of 45
    assert errors[-1] < 0.5 * errors[0]
    values = np.random.default_rng(1).gamma(5.0, 20.0, 5000)
    assert mode(3 * values + 7) == pytest.approx(3 * mode(values) + 7, rel=1e-9)


def test_mode_of_degenerate_samples():
    assert mode(np.array([4.0])) == 4
    assert mode(np.full(100, 7, np.uint16)) == 7
    assert mode(np.array([1, 2, 2, 2, 9], np.uint8)) == pytest.approx(2, abs=0.5)
    assert mode(np.array([0.0] * 90 + list(range(1, 11)))) == pytest.approx(0, abs=0.5)
    with pytest.raises(FitError, match="empty"):
        mode(np.array([]))


def test_several_nir_bands():
    rng = np.random.default_rng(8)
    glint = rng.gamma(1.0, 5.0, (2, 60, 60))
    bands = [Band("BLUE", 480, group="a"), Band("YELLOW", 605, group="b"), Band("N1", 832, group="a"),
             Band("N2", 950, group="b")]  # fmt: skip
    block = np.stack([50 + glint[0], 40 + 0.5 * glint[1], 5 + glint[0], 4 + glint[1]])
    for use in ("set", "best"):
        request = remove.nir_request(bands, [2, 3], use=use)
        assert request.correct == (0, 1)
        plan = METHODS["hedley"].plan(request)
        every = np.ones((60, 60), bool)
        model = METHODS["hedley"].fit(request, merge([gather(block[list(plan.read_bands)], every, plan)], plan))
        assert [f.index for f in model.fits] == [0, 1]
        assert [f.slope for f in model.fits] == pytest.approx([1, 0.5])
    mean = remove.fit("hedley", block, nir=[2, 3], bands=bands)
    assert mean.indexes[0].weights == (0.5, 0.5)
    with pytest.raises(InputError, match="same time as BLUE"):
        remove.nir_request([Band("BLUE", 480), bands[2]], [1], use="set")


def test_a_band_without_wavelength_is_corrected_only_if_none_is_known():
    classes = [Band("BLUE", 480.0), Band("RED", 660.0), Band("NIR", 840.0), Band("classes")]
    assert remove.nir_request(classes, [2]).correct == (0, 1)
    assert remove.nir_request(classes, [2], correct=[0, 3]).correct == (0, 3)
    assert remove.nir_request([Band("a"), Band("b"), Band("NIR", 840.0)], [2]).correct == (0, 1)


@given(st.sampled_from(sorted(METHODS)))
@settings(deadline=None)
def test_models_survive_json(name):
    block, _ = scene(noise=1.0)
    model = fitted(name, block)
    assert GlintModel.from_json(model.to_json()) == model
    assert json.loads(model.to_json())["kind"] == "deglint model"
    assert name in str(model)


NOT_MODELS = ["", "{}", '{"kind": "other", "format": 1}', '{"kind": "deglint model", "format": 99}']


@pytest.mark.parametrize("text", NOT_MODELS)
def test_what_is_not_a_model_is_refused(text):
    with pytest.raises(InputError, match="model"):
        GlintModel.from_json(text)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda m: m["fits"][0].update(band=99),
        lambda m: m["fits"][0].update(index=1),
        lambda m: m["indexes"][0].update(bands=[-1]),
        lambda m: m["indexes"][0].update(weights=[1.0, 1.0]),
        lambda m: m["band_names"].pop(),
        lambda m: m.update(second=2 * m["indexes"]),
        lambda m: m.update(strips={"rows": ["01", "0"]}),
        lambda m: m["fits"][0].update(slope="1"),
        lambda m: m["fits"][0].update(slope=float("nan")),
        lambda m: m["fits"][0].update(band=True),
        lambda m: m["fits"][0].update(band=1),
        lambda m: m["fits"][0].update(slope=10**400),
        lambda m: m.update(strips={"rows": ["01", "01"]}),
        lambda m: m["indexes"][0].update(weights="1"),
        lambda m: m.update(level_interval=[1.0, 2.0]),
        lambda m: m.pop("method"),
    ],
)
def test_a_saved_model_whose_numbers_name_nothing_is_refused(wrong):
    block, _ = scene()
    data = json.loads(fitted("hedley", block).to_json())
    wrong(data)
    with pytest.raises(InputError, match="not a saved deglint model"):
        GlintModel.from_json(json.dumps(data))
    with pytest.raises(InputError, match="it has no entry 'kind'"):
        GlintModel.from_json("{}")


def test_errors_say_what_to_do():
    block, _ = scene()
    with pytest.raises(FitError, match=r"9 valid pixels.*64 are needed"):
        fitted("hedley", block, sample=np.pad(np.ones((3, 3), bool), ((0, 67), (0, 87))))
    with pytest.raises(FitError, match="has 0 valid pixels"):
        fitted("joyce", np.full_like(block, np.nan))
    flat = block.copy()
    flat[NIR] = 5
    with pytest.raises(FitError, match="L840 is constant"):
        fitted("lyzenga", flat)
    with pytest.raises(InputError, match="did you mean 'hedley'"):
        fitted("headley", block)
    with pytest.raises(InputError, match="not one of ols"):
        fitted("hedley", block, "lasso")
    with pytest.raises(BandError, match="within 5 nm of 739 nm"):
        remove.fit("kutser", block[:2], nir=1, bands=[Band("A", 500), Band("B", 840)])
    with pytest.raises(InputError, match="left to correct"):
        remove.fit("hedley", block[:1], nir=0)
    with pytest.raises(InputError, match="for 8 bands"):
        remove.apply(block[:3], fitted("hedley", block))
    with pytest.raises(InputError, match="needs band"):
        fitted("hedley", block).for_bands(("A", "B"))


@pytest.mark.parametrize("name", METHODS)
def test_a_band_named_twice_is_corrected_once(name):
    block, _ = scene(noise=1.0)
    twice = remove.fit(name, block, nir=NIR, bands=BANDS, correct=np.array([0, 1, 2, 0]))
    assert twice == remove.fit(name, block, nir=NIR, bands=BANDS, correct=CORRECT)
    assert GlintModel.from_json(twice.to_json()) == twice


@pytest.mark.parametrize("name", ["hedley", "wiener"])
@pytest.mark.parametrize("kind", ["uint8", "int64", "list"])
def test_a_mask_of_numbers_is_a_mask(name, kind):
    block, _ = scene(noise=1.0)
    model, where = fitted(name, block), np.random.default_rng(4).random(block.shape[1:]) < 0.5
    given = where.tolist() if kind == "list" else where.astype(kind)
    out = remove.apply(block, model, where=given)
    np.testing.assert_array_equal(out, remove.apply(block, model, where=where))
    np.testing.assert_array_equal(out[:, ~where], block[:, ~where])


@pytest.mark.parametrize("name", ["hedley", "wiener"])
@pytest.mark.parametrize("dtype", ["float32", "int16"])
def test_masked_pixels_are_not_valid(name, dtype):
    block, _ = scene(noise=1.0)
    block, holes = np.round(block).astype(dtype), np.zeros(block.shape, bool)
    holes[NIR, 20:30, 20:50] = True
    masked = np.ma.array(np.where(holes, -999, block), dtype, mask=holes)
    plain = np.where(holes, np.nan, block).astype(np.float32)
    model = fitted(name, plain)
    assert fitted(name, masked) == model
    np.testing.assert_array_equal(remove.apply(masked.astype(np.float32), model), remove.apply(plain, model))
    if name == "hedley":
        assert fitted(name, block, sample=np.ma.array(np.ones_like(holes[NIR]), mask=holes[NIR])) == model


@pytest.mark.parametrize("regression", ["huber", "theil-sen"])
def test_a_nir_that_varies_outside_the_pixels_of_the_regression_is_refused(regression, monkeypatch):
    for name in ("ROBUST_PIXELS", "PAIRED_PIXELS"):
        monkeypatch.setattr(f"deglint.remove.statistics.{name}", 4000)
    block, _ = scene(noise=1.0)  # of 6300 pixels, every other one is used
    block[NIR].flat[::2] = 5
    with pytest.raises(FitError, match=r"constant.*3150 pixels.*--regression ols"):
        fitted("hedley", block, regression)
    fitted("hedley", block)


@pytest.mark.parametrize("dent", [0.0, -4.0])
def test_kutser_refuses_bands_without_absorption_by_oxygen(dent):
    rng = np.random.default_rng(6)
    block = np.rint(rng.gamma(1.0, 20.0, (1, 20, 30))) + np.zeros((8, 1, 1))
    block[4] -= np.where(rng.random((20, 30)) < 0.5, dent, -9.0)
    with pytest.raises(FitError, match="no oxygen absorption at 760 nm"):
        fitted("kutser", block)


def test_warnings_of_doubtful_fits():
    block, _ = scene(shape=(20, 20))
    rng = np.random.default_rng(9)
    block[0] = rng.normal(50, 5, (20, 20))
    warnings = fitted("hedley", block).warnings
    assert any("explains only" in w and "L480" in w for w in warnings)
    assert any("small sample: 400 pixels" in w for w in warnings)
    calm = 100 + 0.01 * rng.normal(size=block.shape)
    assert any("uniform sample" in w for w in fitted("hedley", calm).warnings)


def test_one_pixel_outliers_move_the_minimum_but_not_a_percentile():
    block, _ = scene(noise=1.0)
    block[:, 0, 0] = -500
    floor = fitted("hedley", block, floor_percentile=5).indexes[0].level
    assert fitted("hedley", block).indexes[0].level == -500
    assert floor == pytest.approx(np.percentile(block[NIR], 5))


@beside("sentinel2")
def test_palau_agrees_with_independent_software():
    import rasterio
    from rasterio.features import geometry_mask

    with rasterio.open(SHARED / "sentinel2" / "palau.tif") as dataset:
        block = dataset.read()
        bands = [Band(n, float(dataset.tags(i)["wavelength"])) for i, n in enumerate(dataset.descriptions, 1)]
        polygon = json.loads((SHARED / "sentinel2" / "palau_deep_water.geojson").read_text())["features"][0]["geometry"]
        sample = geometry_mask([polygon], dataset.shape, dataset.transform, invert=True)
    with rasterio.open(SHARED / "sentinel2" / "palau_hedley_reference.tif") as dataset:
        reference = dataset.read()
    model = remove.fit("hedley", block, nir=7, sample=sample, bands=bands, correct=(1, 2, 3))
    assert {f.n for f in model.fits} == {12000}
    assert model.indexes[0].level == 151
    assert [round(f.slope, 6) for f in model.fits] == [0.856348, 0.869187, 0.806518]
    assert [round(f.r2, 3) for f in model.fits] == [0.763, 0.788, 0.581]
    out = remove.apply(block, model)
    np.testing.assert_allclose(out[1:4], reference, atol=2e-4, rtol=0)
    assert out[1:4][:, sample].std(axis=1) == pytest.approx([13.45, 12.72, 19.30], abs=0.005)


def test_methods_without_regression_follow_the_nir_of_their_set():
    rng = np.random.default_rng(10)
    glint = rng.gamma(1.0, 5.0, (2, 30, 40))
    bands = [Band("BLUE", 480, group="a"), Band("YELLOW", 605, group="b"), Band("N1", 832, group="a"),
             Band("N2", 950, group="b")]  # fmt: skip
    block = np.stack([50 + glint[0], 40 + glint[1], 0 * glint[0] + glint[0], glint[1]])
    request = remove.nir_request(bands, [2, 3], use="set")
    model = METHODS["nir-subtraction"].fit(request, None)
    np.testing.assert_allclose(remove.apply(block, model)[:2], np.broadcast_to([[[50]], [[40]]], (2, 30, 40)))
    plan = METHODS["hochberg"].plan(request)
    stats = merge([gather(block[list(plan.read_bands)], np.ones((30, 40), bool), plan)], plan)
    out = remove.apply(block, METHODS["hochberg"].fit(request, stats))
    np.testing.assert_allclose(out[0], 50 + glint[0].min(), rtol=1e-12)
    np.testing.assert_allclose(out[1], 40 + glint[1].min(), rtol=1e-12)
