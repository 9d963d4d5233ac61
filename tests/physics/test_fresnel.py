"""Reflection and refraction at the surface: against a reference table and closed forms."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deglint.errors import InputError
from deglint.physics import fresnel

ANGLES = st.floats(0.01, 89.9)
INDICES = st.floats(1.05, 1.6)


def by_angles(angle: float, index: float) -> float:
    """The sine and tangent form, 50 digits."""
    with mpmath.workdps(50):
        outside = mpmath.radians(mpmath.mpf(angle))
        inside = mpmath.asin(mpmath.sin(outside) / mpmath.mpf(index))
        across = mpmath.sin(outside - inside) / mpmath.sin(outside + inside)
        along = mpmath.tan(outside - inside) / mpmath.tan(outside + inside)
        return float((across**2 + along**2) / 2)


def by_blinn(angle: float, index: float) -> float:
    """The form of computer graphics, with g = sqrt(n^2 - 1 + c^2)."""
    c = np.cos(np.radians(angle))
    g = np.sqrt(index**2 - 1 + c**2)
    return 0.5 * ((g - c) / (g + c)) ** 2 * (1 + ((c * (g + c) - 1) / (c * (g - c) + 1)) ** 2)


@pytest.mark.parametrize(
    ("angle", "expected"),
    [
        (0, 0.021112),
        (20, 0.021298),
        (40, 0.025325),
        (60, 0.061005),
        (70, 0.135361),
        (80, 0.350200),
        (85, 0.585329),
    ],
)
def test_reference_table(angle, expected):
    assert fresnel.reflectance(angle, 1.34) == pytest.approx(expected, abs=5e-7)


@given(ANGLES, INDICES)
def test_three_forms_agree(angle, index):
    ours = float(fresnel.reflectance(angle, index))
    assert ours == pytest.approx(by_angles(angle, index), abs=1e-12)
    assert ours == pytest.approx(by_blinn(angle, index), abs=1e-12)


@given(INDICES)
def test_normal_grazing_and_brewster_angles_have_their_closed_forms(index):
    assert fresnel.reflectance(0, index) == pytest.approx(((index - 1) / (index + 1)) ** 2, rel=1e-12)
    assert fresnel.reflectance(90, index) == pytest.approx(1, abs=1e-12)
    brewster = np.degrees(np.arctan(index))
    perpendicular = ((index**2 - 1) / (index**2 + 1)) ** 2  # all of the reflected light
    assert fresnel.reflectance(brewster, index) == pytest.approx(0.5 * perpendicular, rel=1e-12)


def test_grows_with_the_angle():
    assert np.all(np.diff(fresnel.reflectance(np.arange(1, 91))) > 0)


@given(ANGLES, INDICES)
def test_refraction_follows_snell(angle, index):
    inside = np.radians(fresnel.refraction_angle(angle, index))
    assert index * np.sin(inside) == pytest.approx(np.sin(np.radians(angle)), rel=1e-12)


def test_radiance_loses_the_square_of_the_index():
    assert fresnel.radiance_transmittance(0, 1.34) == pytest.approx((1 - 0.021112) / 1.34**2, rel=1e-5)


def test_nan_stays_nan_and_shapes_broadcast():
    out = fresnel.reflectance([[0.0], [np.nan]], [1.33, 1.34, 1.35])
    assert out.shape == (2, 3)
    assert np.isfinite(out[0]).all()
    assert np.isnan(out[1]).all()


@pytest.mark.parametrize("angle", [-1, 91, np.inf, "steep"])
def test_refuses_bad_angles_in_one_line(angle):
    with pytest.raises(InputError, match=r"^angle .*0 to 90 degrees") as caught:
        fresnel.reflectance(angle)
    assert "\n" not in str(caught.value)
