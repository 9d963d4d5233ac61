"""Slopes of waves: against the published laws, and what every model must hold."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deglint.errors import InputError
from deglint.physics import slopes

AXIS = np.linspace(-1.6, 1.6, 801)
CELL = (AXIS[1] - AXIS[0]) ** 2
UP, CROSS = np.meshgrid(AXIS, AXIS, indexing="ij")
WINDS = [2.0, 5.0, 9.0, 14.0, 17.3, 20.0]


@pytest.mark.parametrize("model", slopes.MODELS)
@pytest.mark.parametrize("wind", WINDS)
def test_is_a_density(model, wind):
    p = slopes.density(UP, CROSS, wind, model=model)
    assert p.min() >= 0
    assert p.sum() * CELL == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize("model", slopes.MODELS)
@pytest.mark.parametrize("wind", WINDS)
def test_bare_series_has_the_variances_and_no_mean(model, wind):
    p = slopes.density(UP, CROSS, wind, model=model, clip=False) * CELL
    up, cross = slopes.variances(wind, model=model)
    assert p.sum() == pytest.approx(1, abs=1e-6)
    assert (p * UP).sum() == pytest.approx(0, abs=1e-6)
    assert (p * UP**2).sum() == pytest.approx(up, rel=1e-5)
    assert (p * CROSS**2).sum() == pytest.approx(cross, rel=1e-5)


@pytest.mark.parametrize("wind", [5.0, 9.0])
def test_bare_series_has_the_skewness_and_peakedness(wind):
    p = slopes.density(UP, CROSS, wind, clip=False) * CELL
    x, y = (axis / np.sqrt(v) for axis, v in zip((UP, CROSS), slopes.variances(wind), strict=True))
    assert (p * x**3).sum() == pytest.approx(-(0.04 - 0.033 * wind), abs=1e-4)
    assert (p * x * y**2).sum() == pytest.approx(-(0.01 - 0.0086 * wind), abs=1e-4)
    assert (p * y**4).sum() == pytest.approx(3.40, abs=1e-3)
    assert (p * x**4).sum() == pytest.approx(3.23, abs=1e-3)
    assert (p * x**2 * y**2).sum() == pytest.approx(1.12, abs=1e-3)


@pytest.mark.parametrize(("wind", "expected"), [(2, 26.84), (5, 12.51), (9, 7.348), (14, 4.854)])
def test_flat_facets_have_the_published_density(wind, expected):
    assert float(f"{slopes.density(0, 0, wind, clip=False):.4g}") == expected


@pytest.mark.parametrize(("wind", "expected"), [(2, -0.001), (5, -0.008), (9, -0.021), (14, -0.041)])
def test_most_frequent_slope_is_on_the_windward_side(wind, expected):
    axis = np.arange(-0.1, 0.1, 1e-4)
    mode = axis[np.argmax(slopes.density(axis, 0, wind))]
    assert mode == pytest.approx(expected, abs=6e-4)


def test_negative_mass_of_the_series():
    mass = [np.minimum(slopes.density(UP, CROSS, u, clip=False), 0).sum() * CELL for u in (5.0, 9.0, 14.0)]
    assert mass[0] == mass[1] == 0
    assert mass[2] == pytest.approx(-4.0e-4, abs=1e-5)


def test_variances_grow_with_wind_as_published():
    assert np.sum(slopes.variances(9.0)) == pytest.approx(0.003 + 0.00508 * 9)
    assert slopes.variances(9.0, model="breon-henriot") == pytest.approx((0.02944, 0.01965))
    assert np.sum(slopes.variances(9.0, model="cox-munk-isotropic")) == pytest.approx(0.003 + 0.00512 * 9)


@given(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(0.5, 20.0), st.sampled_from(sorted(slopes.MODELS)))
def test_crosswind_sides_are_alike(up, cross, wind, model):
    left, right = slopes.density(up, [cross, -cross], wind, model=model)
    assert left == pytest.approx(right, rel=1e-12)


@given(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(0.5, 20.0))
def test_gaussian_is_the_density_of_the_gaussian_model(up, cross, wind):
    variances = slopes.variances(wind, model="cox-munk-gaussian")
    plain = slopes.gaussian(up, cross, *variances)
    assert slopes.density(up, cross, wind, model="cox-munk-gaussian") == pytest.approx(plain)


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(-720, 720))
def test_axes_turn_and_turn_back(east, north, wind_from):
    up, cross = slopes.to_wind_axes(east, north, wind_from)
    assert np.hypot(up, cross) == pytest.approx(np.hypot(east, north), abs=1e-12)
    assert slopes.from_wind_axes(up, cross, wind_from) == pytest.approx((east, north), abs=1e-9)


def test_axes_by_compass():
    assert slopes.to_wind_axes(0.0, 1.0, 0.0) == pytest.approx((1.0, 0.0))
    assert slopes.to_wind_axes(1.0, 0.0, 90.0) == pytest.approx((1.0, 0.0), abs=1e-15)
    assert slopes.to_wind_axes(0.0, -1.0, 90.0) == pytest.approx((0.0, 1.0), abs=1e-15)


@settings(max_examples=30)
@given(st.floats(0.5, 30), st.floats(2, 50), st.floats(2, 50))
def test_wind_moves_up_and_down(wind, low, high):
    there = slopes.wind_at_height(wind, measured_at=low, wanted_at=high)
    assert slopes.wind_at_height(there, measured_at=high, wanted_at=low) == pytest.approx(wind)
    if abs(high - low) > 1e-9:  # nearer than that the logarithms may be equal
        assert (there > wind) == (high > low)


def test_wind_at_the_height_of_cox_and_munk():
    assert 1.02 <= slopes.wind_at_height(1.0) <= 1.03


@pytest.mark.parametrize("zenith", [40.0, 70.0, 80.0, 85.0])
@pytest.mark.parametrize("variance", [0.01, 0.03])
def test_hidden_waves_make_up_for_the_surplus_of_projected_area(zenith, variance):
    step = 1e-4
    slope = np.arange(-2, 2, step)
    density = np.exp(-0.5 * slope**2 / variance) / np.sqrt(2 * np.pi * variance)
    area = np.sum(density * np.maximum(1 - slope * np.tan(np.radians(zenith)), 0)) * step
    assert slopes.hidden(zenith, variance) == pytest.approx(area - 1, abs=1e-6)


def test_nothing_hides_from_above():
    assert slopes.hidden([0.0, 20.0], 0.05) == pytest.approx(0, abs=1e-12)


def test_nan_stays_nan():
    out = slopes.density([0.0, np.nan, 0.0], 0.0, [5.0, 5.0, np.nan])
    assert np.isnan(out).tolist() == [False, True, True]


@pytest.mark.parametrize("wind", [0.0, -3.0, 20.1, np.inf])
def test_refuses_wind_beyond_the_models(wind):
    with pytest.raises(InputError, match=r"^wind .*0\.1 to 20 m/s"):
        slopes.density(0, 0, wind)


def test_refuses_unknown_models_and_flat_seas():
    with pytest.raises(InputError, match=r"^model .*one of cox-munk"):
        slopes.density(0, 0, 5.0, model="cox")
    with pytest.raises(InputError, match="variance_upwind must be"):
        slopes.gaussian(0, 0, 0.0, 0.01)
