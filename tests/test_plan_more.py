"""Beyond one reticle: the best viewing geometry, a day, a flight line, an uncertain wind, and their pictures."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deglint.errors import BandError, InputError
from deglint.physics import atmosphere, glint
from deglint.plan import Limits, Mission, reticle
from deglint.plan.charts import day_picture, line_picture, selected, wind_picture
from deglint.plan.draw import MAGENTA, png
from deglint.plan.mission import merged, mission_from, pressure, tables_of
from deglint.plan.picture import DISC_CENTRE, DISC_RADIUS, HEIGHT, WIDTH, layers, picture
from deglint.plan.reticle import MARGIN, best_geometry, compass, one_in, quality, sentence
from deglint.plan.swath import Alternative, FieldOfView, Line, alternatives, viewing_geometries
from deglint.plan.swath import words as sentences
from deglint.plan.sweep import WindEnsemble, best_moment, next_daylight, plans, table, times

from .common import BAY, says


def between(a, b):
    """Angle between two viewing geometries (zenith, azimuth) [degree]."""
    z1, a1, z2, a2 = np.radians([a[0], a[1], b[0], b[1]])
    return np.degrees(np.arccos(np.clip(np.cos(z1) * np.cos(z2) + np.sin(z1) * np.sin(z2) * np.cos(a1 - a2), -1, 1)))


def test_best_geometry_is_the_best_of_those_with_a_margin():
    plan = reticle(BAY)
    geometry = best_geometry(plan)
    out = np.argwhere(plan.excluded)
    apart = [between((geometry.zenith, geometry.azimuth), (plan.zenith[i], plan.azimuth[j])) for i, j in out]
    assert geometry.margin
    assert min(apart) >= MARGIN - plan.mission.step
    assert geometry.contrast > 0.9 * plan.combined.max()
    i, j = int(geometry.zenith / 2), int(geometry.azimuth / 2)
    assert geometry.contrast == plan.combined[i, j]
    assert geometry.glint == plan.glint_strength[i, j] <= plan.mission.limits.glint
    order = [plan.by_band[plan.bands.index(b), i, j] for b in geometry.bands]
    assert order == sorted(order, reverse=True)
    assert min(order) > 0


def test_best_geometry_of_one_band():
    plan = reticle(BAY)
    geometry = best_geometry(plan, band="red")
    k = plan.bands.index("RED")
    assert geometry.bands == ("RED",)
    assert geometry.contrast == plan.by_band[k, round(geometry.zenith / 2), round(geometry.azimuth / 2)]
    assert best_geometry(plan, band="NIR1") is None
    with pytest.raises(BandError, match=r"RED is not in this plan.*BLUE.*-b"):
        best_geometry(reticle(replace(BAY, bands=("BLUE",))), band="RED")


def test_no_good_look_is_said():
    plan = reticle(replace(BAY, limits=Limits(snr=1e5)))
    assert plan.excluded.all()
    assert best_geometry(plan) is None
    assert says(sentence(None), "No viewing geometry is good", "sun glint", "saturation")
    assert picture(plan).shape == (HEIGHT, WIDTH, 3)


def test_a_sliver_of_good_looks_is_taken_without_a_margin():
    plan = reticle(BAY)
    sliver = np.zeros_like(plan.combined)
    sliver[20, 40] = 5.0
    geometry = best_geometry(plan, sliver)
    assert (geometry.zenith, geometry.azimuth, geometry.margin) == (40.0, 80.0, False)
    assert says(quality(geometry), "excluded", "within 3 degrees")


@pytest.mark.parametrize(
    ("azimuth", "name"),
    [(0, "north"), (359, "north"), (45, "north-east"), (202.5, "south-south-west"), (290, "west-north-west")],
)
def test_points_of_the_compass(azimuth, name):
    assert compass(azimuth) == name


@pytest.mark.parametrize(
    ("share", "said"),
    [(3.1e-6, "1 in 320 000"), (1e-12, "less than 1 in a billion"), (0.2, "20 %"), (1.1e-9, "1 in 910 000 000")],
)
def test_small_shares_in_words(share, said):
    assert one_in(share) == said


def test_a_day():
    when = times("2026-06-21T11:00Z", "2026-06-21T20:00Z", 60)
    assert [str(t) for t in (when[0], when[-1])] == ["2026-06-21T11:00:00", "2026-06-21T20:00:00"]
    found = list(plans(BAY, when))
    moments = [m for m, _ in found]
    assert [m.geometry is None for m in moments[:3]] == [True, True, False]
    assert found[0][1] is None
    for moment, plan in found[2:]:
        alone = reticle(replace(BAY, time=moment.time))
        assert moment.geometry == best_geometry(alone)
        np.testing.assert_array_equal(plan.combined, alone.combined)
    best = best_moment(moments)
    assert best.geometry.contrast == max(m.geometry.contrast for m in moments if m.geometry)
    lines = table(moments)
    assert len(lines) == len(when) + 1
    assert "the sun is down" in lines[1]
    assert sum("<- best" in line for line in lines) == 1
    kept = {k: found[k][1] for k in selected(moments)}
    assert kept
    assert None not in kept.values()
    image = day_picture(BAY, moments, kept)
    assert image.dtype == np.uint8
    assert image.std() > 10


def test_a_night_has_no_best_time():
    moments = [m for m, _ in plans(BAY, times("2026-06-21T07:00Z", "2026-06-21T10:00Z", 60))]
    assert best_moment(moments) is None
    assert selected(moments) == []
    assert day_picture(BAY, moments, {}).ndim == 3


def test_spans_of_time_that_cannot_be():
    with pytest.raises(InputError, match=r"^minutes .*0\.02 to 1e"):
        times("2026-06-21T18:00Z", "2026-06-21T19:00Z", 0.005)
    with pytest.raises(InputError, match="must not lie before"):
        times("2026-06-21T11:00Z", "2026-06-21T10:00Z", 30)
    with pytest.raises(InputError, match="needs a place"):
        next(plans(Mission(sun_zenith=30, sun_azimuth=100), times("2026-06-21T00:00Z", "2026-06-21T01:00Z", 30)))


@given(st.floats(0, 360), st.floats(-60, 60))
def test_a_line_scanner_sees_to_both_sides(heading, roll):
    zenith, azimuth = viewing_geometries(FieldOfView(across=10.0, roll=roll, altitude=1.0), heading)
    assert zenith.shape == (1, 121)
    middle = zenith[0, 60]
    assert middle == pytest.approx(abs(roll), abs=1e-4)
    if abs(roll) > 0.1:  # what is right of the track sees the sensor to its left
        side = heading - 90.0 if roll > 0 else heading + 90.0
        assert np.cos(np.radians(azimuth[0, 60] - side)) == pytest.approx(1.0, abs=1e-6)


def test_a_look_ahead_sees_the_sensor_behind():
    zenith, azimuth = viewing_geometries(FieldOfView(across=0.0, pitch=30.0, altitude=1.0), 40.0)
    assert zenith[0, 60] == pytest.approx(30.0, abs=1e-4)
    assert azimuth[0, 60] == pytest.approx(220.0)


def test_from_orbit_the_earth_is_round():
    zenith, _ = viewing_geometries(FieldOfView(across=40.0, altitude=800e3), 0.0)
    assert zenith[0, -1] == pytest.approx(
        np.degrees(np.arcsin(np.sin(np.radians(20.0)) * (6371 + 800) / 6371)), rel=1e-9
    )
    beyond, _ = viewing_geometries(FieldOfView(across=150.0, altitude=800e3), 0.0)
    assert np.isnan(beyond[0, -1])


def test_flight_line_is_the_glint_of_each_look():
    view = FieldOfView(across=50.0, along=20.0, pitch=10.0)
    line = Line(BAY, view, [30.0, 200.0])
    zenith, azimuth = viewing_geometries(view, 200.0)
    wind = BAY.slope_wind
    spark = glint.sun_glint(*BAY.sun, zenith, azimuth, wind=wind.speed, wind_from=310.0).radiance
    assert line.fraction[1] == np.mean(spark > BAY.limits.glint)
    assert line.mean[1] == pytest.approx(spark.mean())
    np.testing.assert_allclose(line.profile[1], spark.max(axis=0))


def test_best_heading_tilts_away_from_the_mirror_point():
    """A view that looks 30 degrees to the right is best flown so that it looks away from where the sun mirrors."""
    line = Line(replace(BAY, wind=5.0), FieldOfView(across=10.0, roll=35.0))
    looks_to = (line.heading[line.best] + 90.0) % 360.0
    mirror_seen_towards = BAY.sun[1]  # looking towards the sun one sees its glint
    assert np.cos(np.radians(looks_to - mirror_seen_towards)) < 0
    assert line.fraction[line.best] == 0.0
    assert "Fly heading" in line.words()
    assert line_picture(BAY, line).shape == (640, 1240, 3)


@pytest.mark.parametrize(("across", "along"), [(40.0, 0.0), (30.0, 20.0)])
def test_where_every_heading_is_in_glint_a_time_and_a_view_angle_are_worked_out(across, along):
    noon = Mission(latitude=20.0, longitude=-157.0, time="2026-06-21T22:00Z", wind=7.0, wind_from=310.0)
    line = Line(noon, FieldOfView(across=across, along=along))
    found = alternatives(noon, line)
    said = sentences(line, found)
    assert said[0].startswith("No heading is good: all of the view")
    assert [text.partition(":")[0] for text in said[1:]] == ["Another time", "Another view angle"]
    for one in found:  # each holds when it is worked out by itself
        mission = noon if one.time is None else replace(noon, time=one.time)
        again = Line(mission, replace(line.view, pitch=one.pitch, roll=one.roll), [one.heading])
        assert again.fraction[0] == one.fraction < 0.02
        assert f"heading {one.heading:03.0f}" in " ".join(said)
    assert not line.is_recommended
    magenta = (line_picture(noon, line, said)[230:, :600] == MAGENTA).all(axis=-1).sum()
    assert magenta == 0  # no arrow for a heading that is not recommended
    good = Line(replace(BAY, wind=5.0), FieldOfView(across=10.0, roll=35.0))
    assert alternatives(BAY, good) == ()
    assert (line_picture(BAY, good)[230:, :600] == MAGENTA).all(axis=-1).sum() > 100


def test_without_a_place_only_the_view_angle_is_worked_out():
    mission = Mission(sun_zenith=10.0, sun_azimuth=100.0, wind=7.0)
    line = Line(mission, FieldOfView(across=30.0))
    assert [one.time for one in alternatives(mission, line)] == [None]
    storm = Mission(sun_zenith=30.0, sun_azimuth=100.0, wind=19.0, limits=Limits(glint=1e-9))
    line = Line(storm, FieldOfView(across=60.0))
    assert "wait for less wind" in sentences(line, alternatives(storm, line))[-1]


@pytest.mark.parametrize(
    ("sun", "across", "said"),
    [
        (
            {"latitude": 20.0, "longitude": -157.0, "time": "2026-06-21T22:00Z"},
            120.0,
            "No other time of the day and no tilt up to 10 degrees is much better",
        ),
        ({"sun_zenith": 30.0, "sun_azimuth": 180.0}, 120.0, "No tilt up to 10 degrees is much better"),
        ({"sun_zenith": 30.0, "sun_azimuth": 180.0}, 150.0, "No other time and no tilt could be tried"),
    ],
)
def test_only_what_was_tried_is_said_to_be_no_better(sun, across, said):
    mission = Mission(**sun, wind=12.0, limits=Limits(glint=1e-12))
    line = Line(mission, FieldOfView(across=across))
    assert sentences(line, alternatives(mission, line))[-1] == f"{said}: wait for less wind."


@pytest.mark.parametrize(
    ("tilt", "said"),
    [
        ({"pitch": 20.0}, "look 20 degrees forward and fly"),
        ({"roll": -20.0}, "look 20 degrees to the left and fly"),
        ({"pitch": -20.0, "roll": 35.0}, "look 20 degrees back and 35 degrees to the right and fly"),
    ],
)
def test_a_recommended_view_angle_is_the_whole_tilt(tilt, said):
    one = Alternative(heading=90.0, fraction=0.01, time=None, **({"pitch": 0.0, "roll": 0.0} | tilt))
    assert said in sentences(Line(BAY, FieldOfView(roll=tilt.get("roll", 0.0))), (one,))[1]


def test_text_and_picture_agree_on_the_worst_heading():
    line = Line(BAY, FieldOfView(across=30.0, roll=20.0))
    assert f"worst is {line.heading[line.worst]:03.0f}" in line.words()
    assert line.fraction[line.worst] == line.fraction.max()


@pytest.mark.parametrize(
    ("start", "found"),
    [("2026-06-21T18:00Z", "2026-06-21T18:00"), ("2026-06-21T08:00Z", "2026-06-21T14:2")],
)
def test_the_next_daylight_is_now_or_in_the_morning(start, found):
    time = next_daylight(36.8, -122.0, start)
    assert str(time).startswith(found)
    assert Mission(latitude=36.8, longitude=-122.0, time=time).sun[0] <= 75.0


def test_the_next_daylight_in_winter_is_the_highest_sun():
    sun = Mission(latitude=60.0, longitude=0.0, time=next_daylight(60.0, 0.0, "2026-12-21T18:00Z")).sun
    assert sun[1] == pytest.approx(180.0, abs=3.0)


def test_any_heading_will_do_where_there_is_no_glint():
    line = Line(Mission(sun_zenith=75.0, sun_azimuth=0.0, wind=2.0), FieldOfView(across=20.0))
    assert line.words().startswith("Any heading will do")


def test_all_of_the_view_off_the_earth_is_spoilt_not_a_crash():
    line = Line(BAY, FieldOfView(across=4.0, pitch=79.0, altitude=30e6), [0.0])
    assert line.fraction[0] == 1.0
    assert np.isfinite(line.mean).all()
    line_picture(BAY, line)


@pytest.mark.slow
def test_an_uncertain_wind_gives_intervals():
    coarse = replace(BAY, step=5.0)
    found = WindEnsemble(coarse, speed=2.0, turn=40.0)
    assert found.winds[0][0] == 5.0
    assert found.winds[0][-1] == 9.0
    for wind, wind_from in ((5.0, 350.0), (9.0, 270.0), (7.0, 310.0)):
        one = reticle(replace(coarse, wind=wind, wind_from=wind_from))
        assert (found.glint[0] <= one.glint_strength).all()
        assert (found.glint[1] >= one.glint_strength).all()
        assert (found.contrast[0] <= one.combined).all()
        assert (found.contrast[1] >= one.combined).all()
    np.testing.assert_array_equal(found.risk > 0, found.contrast[0] == 0)
    geometry = found.best
    low, high = found.at(geometry)["contrast"]
    assert 0 < low <= geometry.contrast <= high
    assert "Whatever the wind" in found.words()[1]
    assert wind_picture(found).shape == (HEIGHT, WIDTH, 3)


def test_a_wind_that_is_known_is_no_interval():
    found = WindEnsemble(replace(BAY, step=5.0), speed=0.0, turn=0.0)
    np.testing.assert_array_equal(found.glint[0], found.glint[1])
    np.testing.assert_array_equal(found.contrast[0], found.middle.combined)
    with pytest.raises(InputError, match="180 stands for not known"):
        WindEnsemble(BAY, turn=200.0)


def test_the_picture_shows_what_the_plan_says():
    """Colours where it is good, hatching where it is not, the best viewing geometry marked; the same every time."""
    plan = reticle(BAY)
    image = picture(plan)
    np.testing.assert_array_equal(image, picture(plan))
    assert png(image)[:8] == b"\x89PNG\r\n\x1a\n"
    from deglint.plan.draw import ORANGE, polar

    def near(zenith, azimuth, reach=12):
        x, y = polar(DISC_CENTRE, DISC_RADIUS, zenith, azimuth, 80.0)
        return (
            image[round(y) - reach : round(y) + reach, round(x) - reach : round(x) + reach].reshape(-1, 3).astype(int)
        )

    geometry = best_geometry(plan)
    assert (np.abs(near(geometry.zenith, geometry.azimuth, 5) - MAGENTA).sum(axis=1) == 0).any()
    glinty = near(45.0, BAY.sun[1] + 180.0)
    assert (np.abs(glinty - ORANGE).sum(axis=1) < 60).any()
    good = near(45.0, BAY.sun[1])
    assert not (np.abs(good - ORANGE).sum(axis=1) < 60).any()


def test_a_sensor_of_many_bands_fits_into_the_picture():
    bands = tuple(replace(BAY.sensor.bands[0], name=f"B{i}", low=450 + 5 * i, high=455 + 5 * i) for i in range(40))
    mission = replace(BAY, step=10.0, sensor=replace(BAY.sensor, bands=bands), bands=())
    assert picture(reticle(mission)).shape == (HEIGHT, WIDTH, 3)
    assert wind_picture(WindEnsemble(mission, speed=0.0, turn=0.0)).shape == (HEIGHT, WIDTH, 3)


@pytest.mark.parametrize("band", [None, "blue", "NIR1"])
def test_hatching_is_where_the_masks_are(band):
    plan = reticle(BAY)
    contrast, patterns = layers(plan, band)
    out = np.any([excess > 0 for excess, _, _ in patterns], axis=0)
    if band is None:
        np.testing.assert_array_equal(out, plan.excluded)
        np.testing.assert_allclose(np.where(out, 0, contrast), plan.combined)
    else:
        k = plan.bands.index(band.upper())
        np.testing.assert_array_equal(out, plan.by_band[k] == 0)


def test_hatching_is_where_the_masks_are_if_no_probability_of_glint_is_allowed():
    low_sun = Mission(sun_zenith=75.0, sun_azimuth=180.0, wind=7.0, step=2.0, limits=Limits(glint_probability=0.0))
    plan = reticle(low_sun)
    _, patterns = layers(plan)
    tiny = (plan.glint_probability > 0) & (plan.glint_probability < 1e-30)
    assert tiny.any()
    np.testing.assert_array_equal(np.any([excess > 0 for excess, _, _ in patterns], axis=0), plan.excluded)


def test_a_mission_survives_its_tables():
    air = atmosphere.Air(visibility=12.0, humidity=60.0)
    made = replace(BAY, air=air, limits=Limits(glint=2e-4, tolerance=1.0), bands=("BLUE", "GREEN"), depth=8.0)
    again = mission_from(tables_of(made))
    assert tables_of(again) == tables_of(made)
    np.testing.assert_allclose(reticle(again).combined, reticle(made).combined, rtol=1e-12)


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"winds": {}}, r"winds is not one of its tables.*\[place\]"),
        ({"wind": {"spd": 3}}, r"unknown key spd in \[wind\].*speed, from"),
        ({"wind": {"speed": "7"}}, r"speed in .wind. .*a number.* '7'"),
        ({"wind": {"speed": True}}, "must be a number"),
        ({"wind": 7}, "wind must be a table"),
        ({"sensor": {"preset": "nonsense"}}, "is not one of thesis"),
        ({"sensor": {"bands": 5}}, r"bands in .sensor. .*a list.* 5"),
        ({"sensor": {"bits": 11.5}}, r"\bbits .*integer.* 11\.5\. Round it"),
        (
            {"sensor": {"band": [{"name": n, "low": 500, "high": 600, "full_scale": 1} for n in "aA"]}},
            "two bands of .* have one name: a, A. Give",
        ),
        ({"sensor": {"bits": float("nan")}}, r"bits in .sensor. .*a number.* nan"),
        ({"sensor": {"band": [{"name": "x"}]}}, "has name, low, high"),
        ({"sensor": {"band": [{"name": "x", "low": 500, "high": 400, "full_scale": 1}]}}, "low < high"),
        ({"air": {"pressure": "30 parsec"}}, "pressure must be like 1013 hPa"),
        ({"air": {"humidity": 130}}, "humidity must be 0 to 100 %"),
        ({"object": {"depth": -3}}, r"\bdepth .*0 to 1000 m.* -3"),
        ({"sensor": {"quantum_efficiency": 0}}, r"\bquantum_efficiency .*0.001 to 1.* 0"),
        ({"sensor": {"transmission": -0.5}}, r"\btransmission .*0.001 to 1.* -0.5"),
        ({"models": {"slopes": ["cox-munk"]}}, "is not one of cox-munk"),
    ],
)
def test_tables_that_cannot_be_read(tables, said):
    with pytest.raises(InputError, match=said):
        mission_from({"sun": {"zenith": 30, "azimuth": 100}, **tables}, "m.toml")


def test_a_sensor_of_ones_own():
    bands = [{"name": "cyan", "low": 480, "high": 500, "full_scale": 0.2}]
    made = mission_from(
        {
            "sun": {"zenith": 30, "azimuth": 100},
            "sensor": {"preset": "micasense", "f_number": 4.0, "bits": 10, "band": bands},
        }
    )
    assert made.sensor.f_number == 4.0
    assert made.sensor.bits == 10
    assert made.sensor.pitch == 3.75e-6
    assert reticle(replace(made, step=5.0)).bands == ("cyan",)


@pytest.mark.parametrize(
    ("text", "value"),
    [("1013.25", 1013.25), ("29.92 inHg", 1013.2), ("760mmHg", 1013.2), ("101.3 kPa", 1013.0), (990, 990)],
)
def test_pressure_in_its_units(text, value):
    assert pressure(text) == pytest.approx(value, abs=0.1)


def test_a_band_named_twice_counts_once():
    assert replace(BAY, bands=("GREEN", "blue", "green")).channels == replace(BAY, bands=("GREEN", "BLUE")).channels


@pytest.mark.parametrize(
    ("speed", "turn", "speeds", "turns"), [(0.0, 180.0, 1, 6), (0.0, 30.0, 1, 7), (2.1, 0.0, 5, 1)]
)
def test_each_wind_of_an_interval_counts_once(speed, turn, speeds, turns):
    found = WindEnsemble(replace(BAY, wind=2.2, step=10.0, bands=("GREEN",)), speed=speed, turn=turn)
    assert tuple(len(set(np.round(w, 6))) for w in found.winds) == tuple(map(len, found.winds)) == (speeds, turns)
    assert (BAY.wind_from in found.winds[1], 2.2 in found.winds[0]) == (True, True)


def test_tables_over_tables():
    below = {"place": {"latitude": 1.0, "time": "x"}, "wind": {"speed": 3.0, "from": 90.0}}
    assert merged(below, {"wind": {"speed": 5.0}})["wind"] == {"speed": 5.0, "from": 90.0}
    assert "place" not in merged(below, {"sun": {"zenith": 1.0}})
    assert below["wind"]["speed"] == 3.0
