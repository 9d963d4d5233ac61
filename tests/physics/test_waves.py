"""Spectra against published and independent values, drawn surfaces against their spectra."""

import numpy as np
import pytest
from scipy.integrate import trapezoid

from deglint.errors import InputError
from deglint.physics import slopes, spectra, waves
from deglint.physics.surface import on_rows, realise
from deglint.physics.waves import Sea

from ..common import says

FREQUENCY = np.geomspace(0.01, 20.0, 20001)


def significant_height(density):
    return 4 * np.sqrt(trapezoid(density, FREQUENCY))


@pytest.mark.parametrize(
    ("wind", "height", "peak"),
    [(5, 0.533, 0.2739), (9, 1.728, 0.1522), (10, 2.133, 0.1370), (15, 4.799, 0.0913)],
)
def test_pierson_moskowitz_gives_the_published_heights(wind, height, peak):
    assert significant_height(spectra.pierson_moskowitz(FREQUENCY, wind_19_5=wind)) == pytest.approx(height, abs=6e-4)
    assert spectra.pierson_moskowitz_peak(wind_19_5=wind) == pytest.approx(peak, abs=6e-5)


@pytest.mark.parametrize(
    ("wind", "fetch", "height"),
    [(5, 10, 0.321), (5, 100, 1.158), (9, 10, 0.541), (9, 50, 1.325), (9, 100, 1.949), (10, 100, 2.140),
     (14, 100, 2.884), (15, 200, 4.51)],
)  # fmt: skip
def test_jonswap_heights_are_the_integral_of_the_formula(wind, fetch, height):
    density = spectra.jonswap(FREQUENCY, wind=wind, fetch=1000.0 * fetch)
    assert significant_height(density) == pytest.approx(height, abs=6e-4)


def test_jonswap_agrees_with_an_independent_program():
    # wavespectra 4.9.0 at 9 m/s and 100 km, which takes g as 9.80665 where deglint takes 9.81
    got = spectra.jonswap(np.array([0.1661, 0.3, 1.0]), wind=9.0, fetch=100e3)
    np.testing.assert_allclose(got, [4.429, 0.2169, 5.921e-4], rtol=1e-3)
    assert spectra.jonswap_peak(wind=9.0, fetch=100e3) == pytest.approx(0.166124, abs=1e-6)


def test_jonswap_is_wavespectra_point_by_point():
    construct = pytest.importorskip("wavespectra.construct.frequency")
    xarray = pytest.importorskip("xarray")
    f = np.geomspace(0.1, 2.0, 300)
    alpha = 0.076 * (9.0**2 / (100e3 * 9.81)) ** 0.22
    freq = xarray.DataArray(f, dims="freq", coords={"freq": f})
    other = construct.jonswap(freq=freq, fp=spectra.jonswap_peak(wind=9.0, fetch=100e3), alpha=alpha, gamma=3.3)
    mine = spectra.jonswap(f, wind=9.0, fetch=100e3)
    np.testing.assert_allclose(mine * (9.80665 / 9.81) ** 2, np.asarray(other), rtol=1e-4)


def test_more_fetch_than_develops_the_sea_changes_nothing():
    developed = spectra.pierson_moskowitz_peak(wind_19_5=1.026 * 9.0)
    assert spectra.jonswap_peak(wind=9.0, fetch=300e3) < developed
    assert spectra.jonswap_peak(wind=9.0, fetch=spectra.developed_fetch(9.0)) == pytest.approx(developed, rel=1e-12)
    far, farther = (Sea(wind=9.0, spectrum="jonswap", fetch=fetch) for fetch in (300e3, 900e3))
    assert far.peak_wavenumber == pytest.approx((2 * np.pi * developed) ** 2 / 9.81, rel=1e-12)
    k = np.geomspace(0.01, 100.0, 2001)
    np.testing.assert_allclose(waves.omnidirectional(k, far), waves.omnidirectional(k, farther), rtol=1e-12)


@pytest.mark.parametrize(
    ("wind", "variance"),
    [
        (3, 0.0254),
        (5, 0.0336),
        (7, 0.0434),
        (9, 0.0553),
        (10, 0.0603),
        (12, 0.0690),
        (14, 0.0763),
        (15, 0.0796),
    ],
)
def test_elfouhaily_slope_variance(wind, variance):
    assert sum(waves.slope_variance(Sea(wind=wind))) == pytest.approx(variance, abs=6e-5)


@pytest.mark.parametrize(("wind", "height"), [(5, 0.650), (9, 2.131), (10, 2.633), (14, 5.162)])
def test_elfouhaily_waves_have_the_published_height(wind, height):
    assert 4 * np.sqrt(height_variance(Sea(wind=wind))) == pytest.approx(height, abs=1e-3)


@pytest.mark.parametrize("wind", [5.0, 9.0, 14.0])
def test_elfouhaily_is_longer_along_the_wind(wind):
    up, cross = waves.slope_variance(Sea(wind=wind))
    assert 1.43 <= up / cross <= 1.485


@pytest.mark.parametrize(
    ("spectrum", "shortest", "variance"),
    [("elfouhaily", 4, 0.0137), ("elfouhaily", 2, 0.0176), ("elfouhaily", 1, 0.0211),
     ("elfouhaily", 0.5, 0.0241), ("elfouhaily", 0.2, 0.0277), ("elfouhaily", 0.1, 0.0309),
     ("elfouhaily", 0.02, 0.0439),
     ("jonswap", 2, 0.0152), ("jonswap", 0.5, 0.0219), ("jonswap", 0.2, 0.0263), ("jonswap", 0.1, 0.0296)],
)  # fmt: skip
def test_slope_variance_of_resolved_waves_at_9_metres_per_second(spectrum, shortest, variance):
    sea = Sea(wind=9.0, spectrum=spectrum)
    assert sum(waves.slope_variance(sea, shortest=shortest)) == pytest.approx(variance, abs=6e-5)


def spreading(angle, exponent, convention):
    """Cos-2s spreading over angles from the wind [deg], of a convention's norm."""
    cosine = np.cos(np.deg2rad(angle))
    shape = (1 + cosine) / 2 if convention == "half-angle" else np.maximum(cosine, 0) ** 2
    return spectra.spreading_norm(exponent, convention) * shape**exponent


@pytest.mark.parametrize("convention", ["half-angle", "full-angle"])
@pytest.mark.parametrize("exponent", [1.0, 2.0, 6.0, 18.0])
def test_spreading_integrates_to_one(convention, exponent):
    angle = np.linspace(-180.0, 180.0, 20001)
    density = spreading(angle, exponent, convention)
    assert trapezoid(density, np.deg2rad(angle)) == pytest.approx(1.0, abs=1e-7)


@pytest.mark.parametrize(
    ("convention", "exponent", "ratio"),
    [("half-angle", 1, 1.0), ("half-angle", 2, 1.4), ("half-angle", 4, 2.33), ("half-angle", 6, 3.31),
     ("half-angle", 18, 9.27), ("full-angle", 1, 3), ("full-angle", 2, 5), ("full-angle", 6, 13),
     ("full-angle", 18, 37)],
)  # fmt: skip
def test_spreading_sets_the_ratio_of_upwind_to_crosswind_slopes(convention, exponent, ratio):
    angle = np.linspace(-180.0, 180.0, 200001)
    density = spreading(angle, exponent, convention)
    along = trapezoid(density * np.cos(np.deg2rad(angle)) ** 2, np.deg2rad(angle))
    assert along / (1 - along) == pytest.approx(ratio, rel=2e-3)
    sea = Sea(wind=9.0, spectrum="jonswap", spreading=convention, exponent=exponent)
    up, cross = waves.slope_variance(sea, shortest=0.2)
    assert up / cross == pytest.approx(along / (1 - along), rel=1e-6)


def divergence(p, q, cell):
    """Kullback-Leibler divergence of two densities on a grid."""
    held = (p > 1e-30) & (q > 1e-12)
    return float((p[held] * np.log(p[held] / q[held])).sum() * cell)


def test_spreading_nearest_to_cox_and_munk_is_s_of_two():
    step = 0.006
    up, cross = np.meshgrid(*2 * [np.arange(-1.5, 1.5, step) + step / 2], indexing="ij")
    measured = slopes.density(up, cross, 9.0)
    found = {}
    for s in (1, 2, 6, 18):
        variance = waves.slope_variance(Sea(wind=9.0, spectrum="jonswap", exponent=s), shortest=0.1)
        drawn = slopes.gaussian(up, cross, *variance)
        found[s] = divergence(drawn, measured, step**2)
    assert found[2] < found[1] < found[6] < found[18]
    np.testing.assert_allclose([found[s] for s in (1, 2, 6, 18)], [0.100, 0.094, 0.201, 0.516], atol=1e-3)


def test_dispersion_joins_gravity_and_surface_tension():
    k = np.array([0.1, 370.0])
    np.testing.assert_allclose(spectra.dispersion(k) ** 2, 9.81 * k + 0.074 / 1025 * k**3)


def height_variance(sea, **band):
    """Variance of the height of the waves of a band of wavelengths."""
    k = waves.wavenumbers(sea, **band)
    return trapezoid(waves.omnidirectional(k, sea) * k, np.log(k))


def slope_correlation(lag, sea, **band):
    """Temporal autocorrelation of the slope at a fixed point, of the waves of a band of wavelengths."""
    k = waves.wavenumbers(sea, **band)
    weight = waves.omnidirectional(k, sea) * k**3
    summed = trapezoid(weight * np.cos(np.asarray(lag)[..., None] * spectra.dispersion(k)), np.log(k), axis=-1)
    return summed / trapezoid(weight, np.log(k))


def test_short_waves_lose_their_memory_as_published():
    # Elfouhaily at 9 m/s after 60 ms, by length; and of waves below 0.2 m after 8, 16 and 30 ms
    sea = Sea(wind=9.0)
    assert float(slope_correlation(0.060, sea, shortest=1.0)) == pytest.approx(0.973, abs=1e-3)
    assert float(slope_correlation(0.060, sea, longest=1.0, shortest=0.2)) == pytest.approx(0.744, abs=1e-3)
    short = slope_correlation(np.array([0.060, 0.008, 0.016, 0.030]), sea, longest=0.2)
    np.testing.assert_allclose(short, [-0.195, 0.688, 0.35, 0.03], atol=6e-3)


SEAS = {
    "elfouhaily": (Sea(wind=5.0, wind_from=30.0), 0.25),
    "jonswap": (Sea(wind=5.0, wind_from=200.0, spectrum="jonswap", fetch=10e3), 0.25),
    "full-angle": (Sea(wind=6.0, spectrum="jonswap", fetch=20e3, spreading="full-angle", exponent=6), 0.4),
    "pierson-moskowitz": (Sea(wind=4.0, wind_from=300.0, spectrum="pierson-moskowitz"), 0.25),
}


@pytest.mark.parametrize("name", SEAS)
def test_drawn_surfaces_have_the_variance_of_the_spectrum(name):
    sea, spacing = SEAS[name]
    got = []
    for seed in range(12):
        surface = realise(sea, shape=(192, 160), spacing=spacing, seed=seed)
        up, cross = slopes.to_wind_axes(*surface.slopes(0.3), sea.wind_from)
        got.append([surface.height(0.3).var(), up.var(), cross.var()])
    got = np.array(got)
    error = got.std(axis=0, ddof=1) / np.sqrt(len(got))
    expected = np.array([surface.height_variance, *surface.slope_variance])
    assert np.all(np.abs(got.mean(axis=0) - expected) < 3 * error), (got.mean(axis=0) - expected) / error
    assert np.all(error < 0.1 * expected)  # or the line above could not fail


@pytest.mark.parametrize("name", SEAS)
def test_a_grid_holds_what_the_integral_over_its_waves_says(name):
    sea, spacing = SEAS[name]
    surface = realise(sea, shape=(512, 512), spacing=spacing)
    # the corners of the square of wavenumbers hold shorter waves than its sides
    low = waves.slope_variance(sea, shortest=2 * spacing)
    high = waves.slope_variance(sea, shortest=np.sqrt(2) * spacing)
    for got, least, most in zip(surface.slope_variance, low, high, strict=True):
        assert 0.98 * least < got < 1.02 * most
    assert surface.height_variance == pytest.approx(height_variance(sea, shortest=2 * spacing), rel=0.02)


@pytest.mark.parametrize("spectrum", ["elfouhaily", "jonswap"])
def test_slopes_forget_as_the_cosine_integral_says(spectrum):
    sea = Sea(wind=5.0, spectrum=spectrum, fetch=10e3)
    lags = np.array([0.010, 0.020, 0.060, 0.120, 0.200])
    got = []
    for seed in range(10):
        surface = realise(sea, shape=(256, 256), spacing=0.1, seed=seed)
        start = np.stack(surface.slopes(0.0)).astype(np.float64)
        got.append([float((start * np.stack(surface.slopes(t))).mean() / (start**2).mean()) for t in lags])
    mean, error = np.mean(got, axis=0), np.std(got, axis=0, ddof=1) / np.sqrt(len(got))
    inner = slope_correlation(lags, sea, shortest=0.2)
    outer = slope_correlation(lags, sea, shortest=0.2 / np.sqrt(2))  # with the corners of the grid
    assert np.all(mean > np.minimum(inner, outer) - 3 * error)
    assert np.all(mean < np.maximum(inner, outer) + 3 * error)
    assert np.all(error < 0.015)


def twin(surface, time):
    """Height and slopes of a surface by a plain sum over its waves."""
    rows, columns = surface.amplitudes.shape
    north = -2 * np.pi * np.fft.fftfreq(rows, surface.spacing)[:, None]
    east = 2 * np.pi * np.fft.fftfreq(columns, surface.spacing)[None, :]
    turned = surface.amplitudes * np.exp(-1j * spectra.dispersion(np.hypot(north, east)) * time)

    def real(spectrum):
        return 2 * np.fft.ifft2(spectrum, norm="forward").real

    return real(turned), real(1j * east * turned), real(1j * north * turned)


@pytest.mark.parametrize("shape", [(48, 36), (45, 51)])
def test_kernels_agree_with_a_plain_sum_over_the_waves(shape):
    surface = realise(Sea(wind=2.0, wind_from=75.0), shape=shape, spacing=0.25, seed=2)
    for time in (0.0, 0.37):
        height, east, north = twin(surface, time)
        np.testing.assert_allclose(surface.height(time), height, atol=2e-6 * np.abs(height).max())
        np.testing.assert_allclose(surface.slopes(time)[0], east, atol=2e-6 * np.abs(east).max())
        np.testing.assert_allclose(surface.slopes(time)[1], north, atol=2e-6 * np.abs(north).max())


@pytest.mark.parametrize("wind_from", [0.0, 90.0, 215.0])
def test_waves_run_downwind(wind_from):
    surface = realise(Sea(wind=3.0, wind_from=wind_from), shape=(128, 128), spacing=0.25, seed=5)
    rising = surface.height(0.01) - surface.height(0.0)
    upwind, _ = slopes.to_wind_axes(*surface.slopes(0.005), wind_from)
    # a wave that runs downwind rises where the surface rises towards upwind: dz/dt = c dz/du
    assert np.corrcoef(rising.ravel(), upwind.ravel())[0, 1] > 0.7


def test_opposing_waves_take_the_travel_away_and_leave_the_variance():
    plain = realise(Sea(wind=3.0), shape=(128, 128), spacing=0.25, seed=5)
    both = realise(Sea(wind=3.0, opposing=0.5), shape=(128, 128), spacing=0.25, seed=5)
    np.testing.assert_allclose(both.slope_variance, plain.slope_variance, rtol=1e-9)
    rising = both.height(0.01) - both.height(0.0)
    assert abs(np.corrcoef(rising.ravel(), both.slopes(0.005)[1].ravel())[0, 1]) < 0.15


def test_same_seed_same_bits_whatever_the_threads():
    sea = Sea(wind=3.0)
    one, two = (realise(sea, shape=(150, 128), spacing=0.25, seed=9, workers=w) for w in (1, 2))
    np.testing.assert_array_equal(one.amplitudes, two.amplitudes)
    np.testing.assert_array_equal(one.field(0.2, slopes=True, workers=1), two.field(0.2, slopes=True, workers=2))
    np.testing.assert_array_equal(one.height(0.2, workers=2), two.height(0.2, workers=1))
    other = realise(sea, shape=(150, 128), spacing=0.25, seed=10)
    assert not np.array_equal(one.amplitudes, other.amplitudes)
    seed = np.random.SeedSequence(9)
    for _ in range(2):
        again = realise(sea, shape=(150, 128), spacing=0.25, seed=seed)
        np.testing.assert_array_equal(again.amplitudes, one.amplitudes)


def test_slabs_cover_all_rows_once():
    for rows in (1, 7, 64):
        for workers in (1, 3):
            seen = np.zeros(rows, int)
            on_rows(lambda a, b, seen=seen: seen.__setitem__(slice(a, b), seen[a:b] + 1), rows, workers)
            assert (seen == 1).all()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Sea(wind=0.5), "wind ... 1 to 20 m/s ... 0.5"),
        (lambda: Sea(wind=30.0), "wind ... 1 to 20 m/s ... 30"),
        (lambda: Sea(wind=5.0, fetch=20.0), "fetch must be 1000 to"),
        (lambda: Sea(wind=5.0, short_gain=-1.0), "short_gain ... 0 to 1000 ... -1"),
        (lambda: Sea(wind=5.0, short_gain=np.nan), "short_gain ... finite number ... nan"),
        (lambda: Sea(wind=5.0, spectrum="swell"), "is not one of elfouhaily"),
        (
            lambda: realise(Sea(wind=9.0), shape=(100, 100), spacing=0.1),
            "73.53 m or 736 points of 0.1 m ... 100",
        ),
        (lambda: realise(Sea(wind=2.0), shape=(100, 100), spacing=2.0), "grid step ... at most 0.908 m"),
        (lambda: realise(Sea(wind=2.0), shape=(4, 100), spacing=0.5), "at least 8 x 8 points"),
        (lambda: waves.slope_variance(Sea(wind=5.0), shortest=0.0), "shortest must be above 0 m"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(make, words):
    with pytest.raises(InputError) as caught:
        make()
    assert says(str(caught.value), *words.split(" ... "))
    assert "\n" not in str(caught.value)
