"""The planner against published numbers, the room it builds on, brute force, other programs and the simulator."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deglint.errors import BandError, InputError
from deglint.physics import atmosphere, glint, slopes, sun, water
from deglint.physics.iops import case1
from deglint.physics.presets import preset
from deglint.physics.sensor import SensorBand, electrons, noise_equivalent_radiance
from deglint.plan import Limits, Mission, reticle
from deglint.plan.dataset import summary
from deglint.plan.picture import place_words
from deglint.plan.reticle import Illumination

from .common import table

THESIS = {
    "sun_zenith": 20.5,
    "sun_azimuth": 270.2,
    "wind": 9.0,
    "wind_height": 12.5,
    "depth": 10.0,
    "air": atmosphere.Air(humidity=80, water_vapour=2.5, wind=9, wind_mean=9, visibility=40, ozone=300),
}
# sun zenith and azimuth; view zenith and azimuth; wind at 12.5 m and from; L/E_n; P; reflectance GC, BH06, Gauss
REFERENCE = [
    (20.5, 270.2, 0, 0, 9, 0, 0.01571, 5.06e-5, (0.0527, 0.0532, 0.0559)),
    (20.5, 270.2, 20.5, 90.2, 9, 0, 0.04181, 1.334e-4, (0.1402, 0.1411, 0.1265)),
    (20.5, 270.2, 40, 90.2, 9, 0, 0.02350, 7.18e-5, (0.0788, 0.0795, 0.0826)),
    (20.5, 270.2, 40, 270.2, 9, 0, 7e-5, 2.2e-7, (0.0002, 0.0001, 0.0001)),
    (30, 180, 30, 0, 5, 0, 0.08014, 2.455e-4, (0.2907, 0.2882, 0.2622)),
    (30, 180, 0, 0, 5, 180, 0.00619, 1.99e-5, (0.0225, 0.0250, 0.0256)),
    (30, 180, 0, 0, 5, 0, 0.00666, 2.14e-5, (0.0242, 0.0250, 0.0256)),
    (30, 180, 0, 0, 5, 90, 0.00361, 1.16e-5, (0.0131, 0.0122, 0.0144)),
    (60, 180, 60, 0, 10, 0, 0.2032, 2.27e-4, (1.277, 1.288, 1.152)),
]


def mission(**changes):
    return Mission(**(THESIS | {"sky": "uniform"} | changes))


def at(plan, layer, zenith, azimuth):
    """A layer at a viewing geometry, linear between the viewing geometries of the reticle."""
    i, j = zenith / plan.mission.step, (azimuth % 360) / plan.mission.step
    low, left = int(i), int(j)
    a, b = i - low, j - left
    box = layer[..., low : low + 2, left : left + 2]
    rows = box[..., 0, :] * (1 - a) + (box[..., 1, :] * a if box.shape[-2] > 1 else 0)
    return rows[..., 0] * (1 - b) + (rows[..., 1] * b if rows.shape[-1] > 1 else 0)


@pytest.mark.parametrize("case", REFERENCE)
def test_reference_values_of_glint(case):
    """Section 2.10 of the tables: to the digits that are printed."""
    zenith, azimuth, view, around, wind, wind_from, radiance, share, reflectances = case
    given = {"sun_zenith": zenith, "sun_azimuth": azimuth, "wind": wind, "wind_from": wind_from}
    for name, wanted in zip(("cox-munk", "breon-henriot", "cox-munk-gaussian"), reflectances, strict=True):
        height = slopes.MODELS[name].height
        plan = reticle(
            Mission(**given, wind_height=height, slopes=name, step=0.5, widest=max(view + 0.5, 10), bands=("BLUE",))
        )
        found = at(plan, plan.glint_strength, view, around)
        assert found * np.pi / np.cos(np.radians(zenith)) == pytest.approx(wanted, abs=6e-5, rel=6e-4)
        if name == "cox-munk":
            assert found == pytest.approx(radiance, abs=6e-6, rel=6e-4)
            assert at(plan, plan.glint_probability, view, around) == pytest.approx(share, rel=6e-3, abs=5e-9)
            if around != 0:
                break  # of the other models, what needs no interpolation


@settings(max_examples=12)
@given(st.floats(0, 80), st.floats(0, 360), st.floats(0.5, 14), st.floats(0, 360), st.sampled_from(list(slopes.MODELS)))
def test_a_reticle_is_the_physics_room_look_by_look(zenith, azimuth, wind, wind_from, model):
    plan = reticle(
        Mission(
            sun_zenith=zenith,
            sun_azimuth=azimuth,
            wind=wind,
            wind_from=wind_from,
            slopes=model,
            step=10.0,
            bands=("GREEN", "NIR1"),
        )
    )
    blows = plan.mission.slope_wind
    one = glint.sun_glint(zenith, azimuth, 40.0, 130.0, wind=blows.speed, wind_from=wind_from, model=model)
    assert plan.glint_strength[4, 13] == pytest.approx(one.radiance, rel=1e-9)
    assert plan.glint_probability[4, 13] == pytest.approx(min(float(one.probability), 1.0), rel=1e-9)
    assert np.isfinite(plan.snr).all()
    assert (plan.snr >= 0).all()
    assert ((plan.sky_probability >= 0) & (plan.sky_probability <= 1)).all()
    np.testing.assert_array_equal(plan.combined == 0, plan.excluded)
    np.testing.assert_allclose(plan.combined[:, 0], plan.combined[:, -1], rtol=1e-6)


@pytest.mark.parametrize("zenith", [0.0, 20.5, 60.0])
@pytest.mark.parametrize("band", ["COASTAL", "GREEN", "NIR2"])
def test_water_is_that_of_the_physics_room_at_every_nanometre(zenith, band):
    made = mission(sun_zenith=zenith, bands=(band,))
    views, turns = np.array([0.0, 13.0, 40.0, 70.0]), np.array([0.2, 90.2, 300.0])
    found = Illumination(made, views, turns)
    edges = made.channels[0]
    wave = np.arange(edges.low, min(edges.high, 1000.0) + 0.5)[:, None, None]
    direct, diffuse = atmosphere.irradiance(wave, zenith, made.weather)
    sea, angles = case1(wave, 0.5), (zenith, views[:, None])
    deep = water.deep_reflectance(sea, *angles, turns - 270.2)
    over = water.submerged_reflectance(
        sea, deep, *angles, depth=10.0, reflectance=0.15, direct_fraction=direct / (direct + diffuse)
    )
    np.testing.assert_allclose(found.background[0], (deep * (direct + diffuse)).mean(axis=0), rtol=1e-10)
    np.testing.assert_allclose(found.target[0], (over * (direct + diffuse)).mean(axis=0), rtol=1e-10)
    assert found.direct[0] == pytest.approx(direct.mean())
    assert found.diffuse[0] == pytest.approx(diffuse.mean())


def test_radiances_of_the_worked_case():
    """Section 8, number 14, which uses another table of the sun: within that table's difference."""
    plan = reticle(mission(bands=("COASTAL", "BLUE", "GREEN", "YELLOW", "RED")))
    weber = {(0, 0): (1.282, 1.924, 2.599, 0.721, 0.050), (40, 0.2): (1.144, 1.717, 2.247, 0.540, 0.029)}
    for geometry, wanted in weber.items():
        np.testing.assert_allclose(at(plan, plan.weber, *geometry), wanted, rtol=0.02, atol=5e-4)
    glints = {
        (0, 0): (0.0183, 0.02316, 0.02296, 0.02177, 0.02013),
        (40, 0.2): (0.00164, 0.00207, 0.00206, 0.00195, 0.0018),
    }
    skies = {
        (0, 0): (0.00205, 0.00189, 0.00148, 0.00122, 0.00104),
        (40, 0.2): (0.00263, 0.00243, 0.0019, 0.00156, 0.00133),
    }
    for geometry in glints:
        np.testing.assert_allclose(at(plan, plan.glint_radiance, *geometry), glints[geometry], rtol=0.03)
        np.testing.assert_allclose(at(plan, plan.sky_radiance, *geometry), skies[geometry], rtol=0.03)
    assert at(plan, plan.glint_probability, 40, 0.2) == pytest.approx(4.5e-6, rel=0.02)


def test_coxmunk_package_agrees():
    """An independent program, in its Gaussian mode: at the mirror point, where its axes do not matter."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        coxmunk = pytest.importorskip("coxmunk")
    for zenith, wind in ((30.0, 5.0), (60.0, 10.0), (20.0, 9.0)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            made = coxmunk.sunglint(zenith, zenith, 180.0, m=1.34)
            theirs = float(made.sunglint(wind, 0.0, stats="cm_iso", shadow=False)[0])
        plan = reticle(
            Mission(
                sun_zenith=zenith,
                sun_azimuth=180.0,
                wind=wind,
                wind_height=12.5,
                slopes="cox-munk-isotropic",
                step=10.0,
                bands=("BLUE",),
            )
        )
        ours = plan.glint_strength[round(zenith / 10), 0] * np.pi / np.cos(np.radians(zenith))
        assert ours == pytest.approx(theirs, rel=0.01)


def test_the_sun_stands_where_pvlib_puts_it():
    import pandas as pd
    from pvlib import solarposition

    times = pd.DatetimeIndex(["2026-06-21T18:00Z", "2026-01-03T21:30Z"])
    theirs = solarposition.get_solarposition(times, 36.8, -122.0, pressure=101325.0, temperature=15.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of pandas, inside pvlib
        air = {"pressure": 101325.0, "temperature": 15.0}
        other = solarposition.get_solarposition(times, 36.8, -122.0, method="ephemeris", **air)
    for oracle, tolerance in ((theirs, 0.005), (other, 0.03)):  # the second is another algorithm, good to that
        for time, zenith, azimuth in zip(times, oracle["apparent_zenith"], oracle["azimuth"], strict=True):
            found = Mission(latitude=36.8, longitude=-122.0, time=time.to_pydatetime()).sun
            assert found == pytest.approx((zenith, azimuth), abs=tolerance)


@pytest.mark.shared
def test_objects_against_the_monte_carlo():
    """288 cases: the thesis' water that only absorbs is far off, water that scatters is not."""
    rows = table("mc_submerged_lambertian_reference.csv")
    sea = case1(rows["lam"], rows["chl"])
    geometry = (30.0, rows["theta_v"])
    target = {"depth": rows["H"], "reflectance": rows["rho"]}
    alone = water.absorption_only_reflectance(sea, *geometry, **target)
    np.testing.assert_allclose(alone, rows["iop_a_only"], rtol=2e-3)
    bright = rows["rho"] == 0.15
    truth = (rows["Rrs_mc"] - rows["Rrs_deep_mc"])[bright]
    deep = water.deep_reflectance(sea, *geometry, rows["phi_v"])
    ours = (water.submerged_reflectance(sea, deep, *geometry, **target) - deep)[bright]
    assert np.sqrt(np.mean((ours / truth - 1) ** 2)) < 0.03
    assert np.mean(alone[bright] / truth - 1) == pytest.approx(0.27, abs=0.03)


@pytest.mark.shared
def test_sunlight_in_the_bands_of_ecolight():
    runs = table("ecolight6_userdata_iop_rrs_sza30.csv")
    rows = runs[runs["run"] == runs["run"][0]]
    bands = [
        SensorBand(name=f"{centre:g}", low=centre - 5, high=centre + 5, full_scale=1.0) for centre in rows["wl_nm"]
    ]
    air = atmosphere.Air(humidity=80, water_vapour=2.5, wind_mean=5, visibility=15, ozone=300, pressure=1012.5)
    sensor = replace(preset("thesis"), bands=tuple(bands))
    plan = reticle(Mission(sun_zenith=30, sun_azimuth=0, wind=5, air=air, sensor=sensor, step=10))
    ratio = rows["Ed_diffuse_W_m2_nm"] / rows["Ed_direct_W_m2_nm"]
    np.testing.assert_allclose(plan.light.diffuse / plan.light.direct, ratio, rtol=0.003)
    np.testing.assert_allclose(plan.light.direct, rows["Ed_direct_W_m2_nm"], rtol=0.04)


def test_water_that_only_absorbs_is_an_option():
    both = [reticle(mission(water=name, bands=("BLUE",), step=5.0)) for name in ("scattering", "absorption")]
    np.testing.assert_array_equal(both[0].light.background, both[1].light.background)
    assert both[1].weber[0, 0, 0] > 1.1 * both[0].weber[0, 0, 0]
    gone = reticle(mission(water="absorption", reflectance=0.0, bands=("BLUE",), step=5.0))
    np.testing.assert_allclose(gone.weber, 0.0, atol=1e-12)


@pytest.mark.slow
def test_mean_glint_of_the_simulator_is_the_planners():
    from deglint.simulate import Setup, simulate

    ours, theirs = [], []
    for seed in range(4):
        setup = Setup(
            size=(256, 256),
            wind=7.0,
            wind_from=40.0,
            sun_zenith=35.0,
            sun_azimuth=135.0,
            seed=seed,
            view_zenith=20.0,
            view_azimuth=320.0,
            patch=0.0,
        )
        scene = simulate(setup)
        theirs.append(scene.glint.mean(axis=(1, 2), dtype=np.float64))
        plan = reticle(
            Mission(
                sun_zenith=35.0,
                sun_azimuth=135.0,
                wind=7.0,
                wind_from=40.0,
                sky=setup.sky,
                air=setup.weather,
                sensor=setup.sensor,
                step=10.0,
            )
        )
        ours.append(plan.glint_radiance[:, 2, 32])
    np.testing.assert_allclose(np.mean(theirs, axis=0), np.mean(ours, axis=0), rtol=0.03)


def test_counts_and_noise_are_those_of_the_sensor():
    plan = reticle(mission(step=10.0, bands=("GREEN",)))
    sensor, band = preset("thesis"), preset("thesis").band("GREEN")
    counts = plan.counts()
    assert counts["background"][0, 4, 3] == pytest.approx(electrons(plan.light.background[0, 4, 3], sensor, band))
    total = plan.light.background + plan.sky_radiance + plan.glint_radiance
    difference = plan.light.target - plan.light.background
    assert plan.snr[0, 4, 3] == pytest.approx(
        difference[0, 4, 3] / noise_equivalent_radiance(total[0, 4, 3], sensor, band), rel=1e-6
    )
    fixed = reticle(mission(step=10.0, bands=("GREEN",), limits=Limits(ner=5e-4)))
    np.testing.assert_allclose(fixed.snr, np.abs(difference) / 5e-4, rtol=1e-9)


def test_masks_follow_their_limits():
    base = reticle(mission(step=4.0))
    strict = reticle(mission(step=4.0, limits=Limits(glint=1e-4, sky_probability=0.01, snr=30.0)))
    for name in ("clear_of_glint", "clear_of_sky", "detectable"):
        assert (getattr(strict, name) <= getattr(base, name)).all()
        assert getattr(strict, name).sum() < getattr(base, name).sum()
    by_share = reticle(mission(step=4.0, limits=Limits(glint=10.0, glint_probability=1e-6)))
    np.testing.assert_array_equal(by_share.clear_of_glint, by_share.glint_probability <= 1e-6)
    wide = reticle(mission(step=4.0, limits=Limits(tolerance=1.0)))
    np.testing.assert_allclose(wide.glint_probability / base.glint_probability, glint.cone(1.0) / sun.solid_angle())


def test_what_saturates_is_not_detectable():
    sensor = preset("thesis")
    dim = replace(sensor, bands=tuple(replace(b, full_scale=0.01) for b in sensor.bands))
    plan = reticle(mission(step=5.0, sensor=dim, bands=("BLUE",)))
    total = plan.light.target + plan.sky_radiance + plan.glint_radiance
    assert not plan.detectable[total >= 0.01].any()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"wind": 25.0}, r"\bwind .*0.1 to 20 m/s.* 25\. The slope models"),
        ({"wind": 0.0}, "wind must be"),
        ({"depth": -1.0}, r"\bdepth .*0 to 1000 m.* -1\. .*positive down"),
        ({"sun_zenith": 91.0}, r"\bsun_zenith .*0 to 89 degrees.* 91"),
        ({"sun_zenith": None}, "go together"),
        ({"reflectance": 15.0}, "Give a share"),
        ({"wind": np.nan}, "wind must be a finite number"),
        ({"time": np.datetime64("NaT", "s")}, r"\btime .*like 2026-06-21T18:00Z.* NaT"),
        ({"slopes": "nonsense"}, "is not one of cox-munk"),
        ({"step": 0.0}, r"\bstep .*0.25 to 10"),
        ({"widest": 90.0}, "widest must be"),
    ],
)
def test_what_no_model_holds_for_is_refused(changes, said):
    with pytest.raises(InputError, match=said) as caught:
        reticle(mission(**changes))
    assert "\n" not in str(caught.value)


def test_numbers_of_numpy_become_those_of_python():
    made = Mission(
        latitude=np.float64(-36.8),
        longitude=np.float32(-122.0),
        time="2026-06-21T21:00Z",
        wind=np.float32(7.0),
        step=np.float64(5.0),
        depth=np.array(3.0),
    )
    assert json.loads(json.dumps(summary(reticle(made))))["mission"]["wind"]["speed"] == 7.0
    assert place_words(made) == "36.80° S  122.00° W"
    assert place_words(replace(made, latitude=np.float32(36.8), longitude=np.float64(122.0))) == "36.80° N  122.00° E"


def test_limits_are_numbers():
    with pytest.raises(InputError, match="glint must be a finite number"):
        Limits(glint=np.nan)


def test_a_band_that_is_not_there():
    with pytest.raises(BandError, match=r"no band 'PURPLE' in thesis.*COASTAL"):
        mission(bands=("PURPLE",))


def test_the_sun_below_the_horizon_says_when_it_rises():
    with pytest.raises(InputError, match=r"below the horizon.*-\d+\.\d degrees.*degree high at 2026-06-21T12:5\dZ"):
        Mission(latitude=36.8, longitude=-122.0, time="2026-06-21T08:00Z")
    with pytest.raises(InputError, match="never 1 degree high"):
        Mission(latitude=85.0, longitude=0.0, time="2026-12-21T12:00Z")
    with pytest.raises(InputError, match="give latitude and longitude"):
        Mission()


def test_nothing_given_is_changed():
    made = mission()
    before = repr(made)
    reticle(made)
    assert repr(made) == before
