"""Sunlight at sea level: against published tables, running codes, and the laws of each gas."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import trapezoid

from deglint.errors import InputError
from deglint.physics import atmosphere
from deglint.physics.atmosphere import Air

from ..common import table

WAVELENGTHS = np.array([400.0, 443, 490, 550, 620, 670, 700])
# rows of the table of Gregg and Carder (1990), extended for HydroLight, at those wavelengths
PAPER = atmosphere.Spectrum(
    irradiance=np.array([1.674, 1.957, 1.938, 1.878, 1.731, 1.531, 1.411]),
    ozone=np.array([0, 0.003, 0.0183, 0.0838, 0.1041, 0.0463, 0.0216]),
    oxygen=np.array([0, 0, 0, 0, 0, 0, 0]),
    water_vapour=np.array([0, 0, 0, 0, 0, 0.0001, 0.602]),
)
CASES = {
    "A": (30.0, Air(1, 80, 2.5, 5, 5, 15, 300)),
    "B": (60.0, Air(1, 80, 1.5, 4, 6, 23, 350)),
    "C": (20.5, Air(1, 80, 2.5, 9, 9, 40, 300)),
    "D": (0.0, Air(10, 50, 1.5, 0, 0, 5, 300)),
}
SPECTRA = {
    "A": (
        (0.6900, 0.9379, 1.0214, 1.0441, 1.0062, 0.9296, 0.8043),
        (0.4361, 0.4765, 0.4458, 0.4029, 0.3544, 0.3126, 0.2643),
    ),
    "B": (
        (0.2835, 0.4272, 0.4947, 0.5189, 0.5120, 0.4888, 0.4283),
        (0.2822, 0.3015, 0.2764, 0.2419, 0.2105, 0.1894, 0.1614),
    ),
    "C": (
        (0.9570, 1.2782, 1.3738, 1.3893, 1.3253, 1.2152, 1.0511),
        (0.3244, 0.3142, 0.2648, 0.2180, 0.1793, 0.1533, 0.1285),
    ),
    "D": (
        (0.2249, 0.4219, 0.5916, 0.7596, 0.8746, 0.8822, 0.8175),
        (0.8716, 1.0142, 0.9473, 0.8043, 0.6275, 0.4998, 0.4070),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_spectra_with_the_table_of_the_paper(name):
    zenith, air = CASES[name]
    found = atmosphere.irradiance(WAVELENGTHS, zenith, air, spectrum=PAPER)
    # case D has humidity 50 %, where the codes' exponent 0.333 for 1/3 moves the last digit
    tolerance = 1.1e-4 if name == "D" else 5.1e-5
    assert found.direct == pytest.approx(np.array(SPECTRA[name][0]), abs=tolerance)
    assert found.diffuse == pytest.approx(np.array(SPECTRA[name][1]), abs=tolerance)


def test_spectrum_with_the_table_of_this_package():
    found = atmosphere.irradiance(WAVELENGTHS, *CASES["A"])
    direct = (0.7092, 0.8864, 1.1082, 1.0416, 0.9912, 0.9354, 0.7975)
    diffuse = (0.4483, 0.4503, 0.4837, 0.4020, 0.3491, 0.3145, 0.2621)
    assert found.direct == pytest.approx(np.array(direct), abs=5.1e-5)
    assert found.diffuse == pytest.approx(np.array(diffuse), abs=5.1e-5)


@pytest.mark.parametrize(
    ("low", "high", "direct", "diffuse"),
    [
        (400, 450, 0.7796, 0.4301),
        (450, 510, 1.0418, 0.4695),
        (510, 580, 1.0300, 0.4019),
        (585, 625, 0.9832, 0.3522),
        (630, 690, 0.9148, 0.3106),
        (770, 895, 0.6433, 0.1966),
    ],
)
def test_means_over_the_bands_of_worldview(low, high, direct, diffuse):
    found = atmosphere.irradiance(np.arange(low, high + 1.0), *CASES["A"])
    assert found.direct.mean() == pytest.approx(direct, rel=1e-3)
    assert found.diffuse.mean() == pytest.approx(diffuse, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "exponent", "turbidity", "asymmetry", "albedo"),
    [
        ("A", 0.2174, 0.2289, 0.7892, 0.9928),  # printed by EcoLight 6
        ("B", 0.1598, 0.1545, 0.7974, None),
        ("C", 0.0296, 0.0960, 0.8158, None),
        ("D", 2.3331, None, 0.65, 0.9545),
    ],
)
def test_aerosol_to_four_digits(name, exponent, turbidity, asymmetry, albedo):
    expected = (exponent, turbidity, asymmetry, albedo)
    for found, wanted in zip(atmosphere.navy_aerosol(CASES[name][1]), expected, strict=True):
        assert wanted is None or found == pytest.approx(wanted, abs=5.1e-5)


@pytest.mark.parametrize(
    ("humidity", "kind", "mean", "wind", "visibility", "expected"),
    [
        (80, 1, 4, 6, 15, (0.1598, 0.2369, 0.7974, 0.9928)),
        (80, 5, 5, 5, 23, (0.9130, 0.0985, 0.6907, 0.9797)),
        (80, 3, 4, 4, 23, (0.7872, 0.1062, 0.7085, 0.9863)),
        (0, 1, 9, 9, 40, (0.1368, 0.0901, 0.8006, 0.9688)),
        (95, 1, 10, 15, 23, (-0.2309, 0.1952, 0.82, 0.9974)),
    ],
)
def test_aerosol_against_running_codes(humidity, kind, mean, wind, visibility, expected):
    found = atmosphere.navy_aerosol(Air(kind, humidity, 1.5, mean, wind, visibility))
    # Away from 80 % the codes' rounded growth exponent, 0.333 for 1/3, moves alpha by 2e-4 (see below); their
    # asymmetry has 0.14167 where the paper has 0.1417.
    tolerances = (5.1e-5 if humidity == 80 else 2.6e-4, 5.1e-5, 1e-4, 5.1e-5)
    for value, wanted, tolerance in zip(found, expected, tolerances, strict=True):
        assert value == pytest.approx(wanted, abs=tolerance)


def test_the_rounded_exponent_explains_what_is_left():
    radii, modes = np.array([0.1, 1, 10]), np.array([0.03, 0.24, 2.0])
    for humidity, mean, wind, wanted in ((0, 9, 9, 0.1368), (95, 10, 15, -0.2309)):
        growth = ((2 - humidity / 100) / (6 * (1 - humidity / 100))) ** 0.333
        amounts = np.array([2000, 5.866 * (mean - 2.2), 0.01527 * (wind - 2.2) * 0.05])
        number = (amounts * np.exp(-(np.log(radii[:, None] / (growth * modes)) ** 2)) / growth).sum(1)
        slope = np.polyfit(np.log10(radii), np.log10(number), 1)[0]
        assert -(slope + 3) == pytest.approx(wanted, abs=5.1e-5)


def test_paths_and_forward_share():
    assert atmosphere.air_mass(60) == pytest.approx(1.9943, abs=5.1e-5)
    assert atmosphere.air_mass(20.5) == pytest.approx(1.0671, abs=5.1e-5)
    assert atmosphere.forward_share(60, 0.7974) == pytest.approx(0.8860, abs=5.1e-5)
    assert atmosphere.forward_share(20.5, 0.8158) == pytest.approx(0.9517, abs=5.1e-5)


def test_air_mass_against_pvlib():
    import pvlib

    zenith = np.arange(0.0, 90.0, 5.0)
    theirs = pvlib.atmosphere.get_relative_airmass(zenith, "kastenyoung1989")
    assert atmosphere.air_mass(zenith) == pytest.approx(np.asarray(theirs), rel=1e-9)


def test_against_another_clear_sky():
    import pvlib

    turbidity = 0.2289 * 0.5**-0.2174
    air = (101325, 1.154, 2.5, 0.3, turbidity)
    theirs = pvlib.spectrum.spectrl2(30.0, 30.0, 0.0, 0.06, *air, dayofyear=94, alpha=0.2174)
    which = [int(np.argmin(abs(theirs["wavelength"] - w))) for w in (450, 550)]
    ours = atmosphere.irradiance([450.0, 550.0], *CASES["A"], day=94)
    direct = np.ravel(theirs["dni"])[which] * np.cos(np.radians(30))
    assert ours.direct == pytest.approx(direct, rel=0.05)


@pytest.mark.shared
def test_irradiance_is_that_of_ecolight():
    runs = table("ecolight6_userdata_iop_rrs_sza30.csv")
    for row in runs[runs["run"] == runs["run"][0]]:
        band = np.linspace(row["wl_nm"] - 5, row["wl_nm"] + 5, 21)
        found = atmosphere.irradiance(band, 30, CASES["A"][1], pressure=29.9 * 33.8639)
        direct, diffuse = found.direct.mean(), found.diffuse.mean()
        assert diffuse / direct == pytest.approx(row["Ed_diffuse_W_m2_nm"] / row["Ed_direct_W_m2_nm"], rel=0.003)
        assert direct == pytest.approx(row["Ed_direct_W_m2_nm"], rel=0.04)
        assert diffuse == pytest.approx(row["Ed_diffuse_W_m2_nm"], rel=0.04)


@pytest.mark.shared
@pytest.mark.parametrize(("name", "total"), [("A", 401.98), ("B", 211.58), ("C", 447.69)])
def test_light_for_photosynthesis(name, total):
    rows = table("gregg_carder_1990_hydrolight_350_801.csv")
    names = ("F0_W_m2_nm", "a_ozone_cm1", "a_oxygen_cm1", "a_water_vapour_cm1")
    rows = rows[(rows["wavelength_nm"] >= 400) & (rows["wavelength_nm"] <= 700)]
    spectrum = atmosphere.Spectrum(*(rows[n] for n in names))
    found = atmosphere.irradiance(rows["wavelength_nm"], *CASES[name], spectrum=spectrum)
    assert trapezoid(found.direct + found.diffuse, rows["wavelength_nm"]) == pytest.approx(total, abs=0.006)


@given(st.floats(300, 1000), st.floats(0, 85), st.floats(1, 10), st.floats(0, 100), st.floats(2, 100))
def test_no_more_light_than_the_sun_sends(wavelength, zenith, kind, humidity, visibility):
    air = Air(kind, humidity, visibility=visibility)
    direct, diffuse = atmosphere.irradiance(wavelength, zenith, air)
    sent = atmosphere.table_spectrum(wavelength).irradiance * np.cos(np.radians(zenith))
    assert direct >= 0
    assert diffuse > 0
    assert direct + diffuse < sent


@pytest.mark.parametrize(
    ("gas", "amount", "law"),
    [
        ("ozone", 2.0, lambda a, m: np.exp(-a * 0.32 * (1 + 22 / 6370) / np.sqrt(0.25 + 44 / 6370))),
        ("oxygen", 0.5, lambda a, m: np.exp(-1.41 * a * m * 0.9 / (1 + 118.3 * a * m * 0.9) ** 0.45)),
        ("water_vapour", 0.3, lambda a, m: np.exp(-0.2385 * a * 1.7 * m / (1 + 20.07 * a * 1.7 * m) ** 0.45)),
    ],
)
def test_each_gas_by_its_law(gas, amount, law):
    clear = atmosphere.Spectrum(*(np.array(x) for x in (1.0, 0.0, 0.0, 0.0)))
    air = Air(ozone=320, water_vapour=1.7, pressure=0.9 * 1013.25)
    without = atmosphere.irradiance(800, 60, air, spectrum=clear)
    found = atmosphere.irradiance(800, 60, air, spectrum=clear._replace(**{gas: np.array(amount)}))
    expected = law(amount, 1 / (0.5 + 0.50572 * 36.07995**-1.6364))
    assert found.direct / without.direct == pytest.approx(expected, rel=1e-9)
    assert found.diffuse / without.diffuse == pytest.approx(expected, rel=1e-9)


def test_clearer_air_gives_more_sun_and_less_sky():
    hazy, clear = (atmosphere.irradiance(550, 30, visibility=v) for v in (5, 40))
    assert clear.direct > hazy.direct
    assert clear.diffuse < hazy.diffuse
    assert clear.direct + clear.diffuse > hazy.direct + hazy.diffuse


def test_distance_scales_both():
    mean, near = atmosphere.irradiance(550, 30), atmosphere.irradiance(550, 30, day=3)
    assert near.direct / mean.direct == pytest.approx(1.0167**2)
    assert near.diffuse / mean.diffuse == pytest.approx(1.0167**2)


def test_sun_on_the_horizon_gives_no_direct_light():
    direct, diffuse = atmosphere.irradiance(550, 90)
    assert direct == pytest.approx(0, abs=1e-12)
    assert diffuse == pytest.approx(0, abs=1e-12)


def test_broadcasts_and_keeps_nan():
    found = atmosphere.irradiance(np.array([[450.0], [np.nan]]), [10.0, 20.0, np.nan])
    assert found.direct.shape == found.diffuse.shape == (2, 3)
    assert np.isnan(found.direct).tolist() == [[False, False, True], [True, True, True]]


def test_ozone_is_that_of_the_climatology():
    # the example of ozone_.m of the Moss Landing Marine Laboratories
    assert atmosphere.ozone(36, -122, 185) == pytest.approx(321.2, abs=0.05)
    assert atmosphere.ozone(0, 10, 100) == pytest.approx(235)
    assert atmosphere.ozone(40, 238, 80) == pytest.approx(float(atmosphere.ozone(40, -122, 80)))
    spring, autumn = atmosphere.ozone(-45, 20, [290, 110])
    assert spring > autumn


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"humidity": np.nan}, "humidity must be a finite number"),
        ({"visibility": [5, 10]}, r"\bvisibility .*finite number.* \[5, 10\]"),
        ({"visibility": "15"}, r"\bvisibility .*finite number.* '15'"),
        ({"humidity": 101}, r"\bhumidity .*0 to 100 %.* 101"),
        ({"pressure": 29.92}, r"\bpressure .*500 to 1100 hPa.* 29.92.*inHg"),
        ({"air_mass_type": 0}, r"\bair_mass_type .*1 to 10"),
        ({"visibility": 0}, r"\bvisibility .*1 to 200 km"),
    ],
)
def test_refuses_impossible_air(params, message):
    with pytest.raises(InputError, match=message):
        atmosphere.irradiance(550, 30, **params)


def test_refuses_wavelengths_beyond_the_table_and_a_sun_that_is_down():
    with pytest.raises(InputError, match=r"^wavelength .*300 to 1000 nm.* 0\.55"):
        atmosphere.irradiance(0.55, 30)
    with pytest.raises(InputError, match=r"^sun_zenith .*0 to 90 degrees.* 100\b"):
        atmosphere.irradiance(550, 100)
