"""Light out of the water: against tables, EcoLight and Monte Carlo."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deglint.errors import InputError
from deglint.physics import fresnel, iops, water

from ..common import table

CHLOROPHYLL = np.array([0.03, 0.1, 0.25, 0.5, 1.0, 2.5])


def deep_water(wavelength, chlorophyll, *angles):
    """Reflectance of deep case-1 water."""
    return water.deep_reflectance(iops.case1(wavelength, chlorophyll), *angles)


def over_object(wavelength, chlorophyll, sun, view, turn, **options):
    """Reflectance over an object in case-1 water."""
    sea = iops.case1(wavelength, chlorophyll)
    deep = water.deep_reflectance(sea, sun, view, turn)
    return water.submerged_reflectance(sea, deep, sun, view, **options)


def rms(error):
    return float(np.sqrt(np.mean(np.square(error))))


@pytest.mark.parametrize(
    ("chlorophyll", "wavelength", "a", "b_w", "b_b"),
    [
        (0.1, 490, 0.023977, 0.002774, 0.002106),
        (0.1, 550, 0.060772, 0.001707, 0.001531),
        (0.5, 490, 0.040114, 0.002774, 0.003333),
        (0.5, 550, 0.066579, 0.001707, 0.002750),
        (1.0, 490, 0.053864, 0.002774, 0.004335),
        (1.0, 550, 0.072574, 0.001707, 0.003765),
    ],
)
def test_properties_of_case_1_water(chlorophyll, wavelength, a, b_w, b_b):
    found = iops.case1(wavelength, chlorophyll)
    assert found.absorption == pytest.approx(a, abs=6e-7)
    assert 2 * found.water_backscattering == pytest.approx(b_w, abs=6e-7)
    assert found.backscattering == pytest.approx(b_b, abs=6e-7)


@pytest.mark.parametrize(
    ("wavelength", "a", "b"),
    [
        (400, 0.00222, 0.00659),
        (443, 0.0060, None),
        (490, 0.0146, 0.00277),
        (550, 0.0585, 0.00171),
        (600, 0.2347, None),
        (660, 0.4114, None),
        (700, 0.6085, None),
        (750, 2.635, None),
        (800, 1.960, None),
        (850, 4.386, None),
    ],
)
def test_pure_sea_water(wavelength, a, b):
    found = iops.case1(wavelength, 0.01)
    yellow = 0.2 * iops.particle_absorption(440, 0.01) * np.exp(-0.014 * (wavelength - 440))
    pure = found.absorption - iops.particle_absorption(wavelength, 0.01) - yellow
    assert pure == pytest.approx(a, rel=2.5e-3)
    assert b is None or 2 * found.water_backscattering == pytest.approx(b, rel=2.5e-3)


@pytest.mark.parametrize(
    ("wavelength", "expected"),
    [
        (443, (0.01023, 0.00726, 0.00547, 0.00445, 0.00367, 0.00294)),
        (490, (0.00484, 0.00448, 0.00420, 0.00400, 0.00381, 0.00358)),
        (555, (0.00096, 0.00117, 0.00147, 0.00182, 0.00229, 0.00302)),
    ],
)
def test_deep_water_from_above(wavelength, expected):
    found = deep_water(wavelength, CHLOROPHYLL, 30, 0, 0)
    assert found == pytest.approx(np.array(expected), abs=5.1e-6)


def test_coefficients_of_lee_2011():
    one = np.ones(1)
    found = [
        float(water.deep_reflectance(iops.Iops(a * one, w * one, p * one), 30, 0, 0)[0])
        for a, w, p in ((0.9, 0.1, 0.0), (0.8, 0.2, 0.0), (0.9, 0.0, 0.1), (0.8, 0.0, 0.2))
    ]
    g = (0.0588147, 0.0506270, 0.0399701, 0.1398902)
    expected = [(g[i] + g[i + 1] * u) * u for i in (0, 2) for u in (0.1, 0.2)]
    assert found == pytest.approx(expected, rel=2e-6)


@pytest.mark.shared
def test_deep_water_against_ecolight():
    rows = table("ecolight6_userdata_iop_rrs_sza30.csv")
    given_water = iops.Iops(*(rows[n] for n in ("a_total", "bb_water", "bb_other")))
    truth = rows["Rrs_sr"]
    u = rows["bb_total"] / (rows["a_total"] + rows["bb_total"])
    lee_2011 = water.deep_reflectance(given_water, 30, 0, 0) / truth - 1
    assert rms(lee_2011[u < 0.12]) < 0.025
    assert rms(lee_2011) < 0.09


@pytest.mark.shared
def test_objects_against_monte_carlo():
    rows = table("mc_submerged_lambertian_reference.csv")
    looks = (rows["lam"], rows["chl"], 30, rows["theta_v"], rows["phi_v"])
    deep = deep_water(*looks)
    found = over_object(*looks, depth=rows["H"], reflectance=rows["rho"])
    error = found / rows["Rrs_mc"] - 1
    assert len(error) == 288
    assert rms(error) < 0.015
    assert abs(error.mean()) < 0.004
    bright = rows["rho"] == 0.15
    difference = (found - deep)[bright] / (rows["Rrs_mc"] - rows["Rrs_deep_mc"])[bright] - 1
    assert rms(difference) < 0.024
    assert rms(deep / rows["Rrs_deep_mc"] - 1) < 0.027
    assert np.max(np.abs(deep / rows["Rrs_deep_mc"] - 1)) < 0.058


@pytest.mark.parametrize(
    ("wavelength", "view", "expected"),
    [
        (490, 0, (0.02262, 0.01628, 0.01210, 0.00937, 0.00397)),
        (490, 60, (0.02129, 0.01482, 0.01071, 0.00821, 0.00422)),
        (550, 0, (0.01996, 0.01144, 0.00691, 0.00456, 0.00189)),
    ],
)
def test_an_object_at_four_depths_against_monte_carlo(wavelength, view, expected):
    depths = np.array([2.0, 6.0, 10.0, 14.0, 1000.0])
    found = over_object(wavelength, 0.5, 30, view, 90, depth=depths, reflectance=0.15)
    assert found == pytest.approx(np.array(expected), rel=0.03)


ANGLES = {"sun": st.floats(0, 74), "view": st.floats(0, 69), "turn": st.floats(-360, 360)}
WATERS = st.tuples(st.floats(350, 800), st.floats(0.02, 20))


@given(WATERS, *ANGLES.values())
def test_deep_below_is_no_object(looked_at, sun, view, turn):
    deep = deep_water(*looked_at, sun, view, turn)
    found = over_object(*looked_at, sun, view, turn, depth=1000, reflectance=0.5)
    assert found == pytest.approx(float(deep), rel=1e-6)


@given(WATERS, *ANGLES.values(), st.floats(0.05, 0.9), st.floats(0, 1))
def test_at_the_surface_is_a_wet_panel(looked_at, sun, view, turn, albedo, direct):
    found = over_object(*looked_at, sun, view, turn, depth=0, reflectance=albedo, direct_fraction=direct)
    entering = direct * (1 - fresnel.reflectance(sun)) + (1 - direct) * 0.934
    panel = entering * fresnel.radiance_transmittance(view) * albedo / np.pi / (1 - 0.48 * albedo)
    assert found == pytest.approx(float(panel), rel=1e-9)


@given(WATERS, *ANGLES.values(), st.floats(0.1, 30))
def test_brighter_objects_are_brighter(looked_at, sun, view, turn, depth):
    found = [over_object(*looked_at, sun, view, turn, depth=depth, reflectance=r) for r in (0, 0.1, 0.5, 1)]
    assert np.all(np.diff(found) >= 0)
    assert np.all(np.array(found) >= 0)


@given(WATERS, *ANGLES.values())
def test_left_and_right_of_the_sun_are_alike(looked_at, sun, view, turn):
    here = deep_water(*looked_at, sun, view, turn)
    for same in (-turn, turn + 360, 360 - turn):
        assert deep_water(*looked_at, sun, view, same) == pytest.approx(float(here), rel=1e-9)


@given(WATERS, ANGLES["turn"], ANGLES["turn"])
def test_from_above_there_is_no_azimuth(looked_at, one, other):
    here, there = (deep_water(*looked_at, 45.0, 0.0, turn) for turn in (one, other))
    assert here == pytest.approx(float(there), rel=1e-9)


def test_molecules_shine_back_to_the_sun():
    towards, away = deep_water(443, 0.05, 45, 45, [0, 180])
    assert towards > 1.05 * away


def test_beyond_the_table_its_edge_is_used():
    sea = iops.case1(490, 0.5)
    found = water.deep_reflectance(sea, [30, 80, 30], [75, 30, 70], 90)
    np.testing.assert_array_equal(found, water.deep_reflectance(sea, [30, 75, 30], [70, 30, 70], 90))
    terms = np.stack(water.lee_2011_terms(sea))
    assert found[2] == pytest.approx(float(water.lee_2011(30, 70, 90) @ terms), rel=1e-12)
    np.testing.assert_array_equal(water.lee_2011(80, 75, 90), water.lee_2011(75, 70, 90))


def test_colours_follow_chlorophyll():
    blue, green = (deep_water(w, CHLOROPHYLL, 30, 0, 0) for w in (443, 555))
    assert np.all(np.diff(blue) < 0)
    assert np.all(np.diff(green) > 0)
    assert np.all(np.diff(blue / green) < 0)


def test_broadcasts_and_keeps_nan():
    wavelength = np.array([450.0, 550.0, np.nan])[:, None, None]
    view = np.array([[0.0], [30.0], [np.nan], [80.0]])
    found = over_object(wavelength, 0.5, 30, view, [0, 90], depth=5, reflectance=0.1)
    assert found.shape == (3, 4, 2)
    expected = np.zeros((3, 4, 2), bool)
    expected[2] = expected[:, 2] = True
    assert np.array_equal(np.isnan(found), expected)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"depth": -1, "reflectance": 0.1}, r"\bdepth .*0 to 1000 m.* -1. Give metres below"),
        ({"depth": 1, "reflectance": 15}, r"\breflectance .*0 to 1.* 15. Give a share"),
        ({"depth": 1, "reflectance": 0.1, "direct_fraction": 2}, r"\bdirect_fraction .*0 to 1"),
    ],
)
def test_refuses_impossible_objects(options, message):
    with pytest.raises(InputError, match=message):
        over_object(490, 0.5, 30, 0, 0, **options)


def test_refuses_impossible_water():
    with pytest.raises(InputError, match=r"^chlorophyll .*0\.01 to 30 mg.* 0\b"):
        iops.case1(490, 0.0)
    with pytest.raises(InputError, match=r"^wavelength .*300 to 1000 nm.* 1100"):
        iops.case1(1100, 0.5)
