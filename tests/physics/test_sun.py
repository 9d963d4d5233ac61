"""The place of the sun: against pvlib and published times."""

import time
import warnings
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from deglint.errors import InputError
from deglint.physics import sun

PLACES = [(36.8, -122.0), (0.0, 0.0), (-33.9, 18.4), (64.1, -21.9)]
TIMES = np.array(["2026-06-21T18:00", "2026-12-21T12:00", "2027-03-20T09:30", "2025-09-01T16:15"], "datetime64[s]")


@pytest.mark.parametrize("place", PLACES)
def test_against_another_algorithm_of_pvlib(place):
    import pandas as pd
    import pvlib

    ours = sun.position(*place, TIMES, refraction=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that algorithm asks pandas for a name it gave up
        theirs = pvlib.solarposition.ephemeris(pd.DatetimeIndex(TIMES, tz="UTC"), *place)
    assert ours.zenith == pytest.approx(90 - theirs["elevation"].to_numpy(), abs=0.02)
    sines = np.sin(np.radians(ours.zenith))
    off = (ours.azimuth - theirs["azimuth"].to_numpy() + 180) % 360 - 180
    assert off * sines == pytest.approx(0, abs=0.02)


def test_against_the_published_example():
    # Reda and Andreas (2004), table A5.1: 17 October 2003, 12:30:30 at UTC-7, Golden, Colorado
    moment = datetime(2003, 10, 17, 12, 30, 30, tzinfo=timezone(timedelta(hours=-7)))
    zenith, azimuth = sun.position(39.742476, -105.1786, moment, pressure=820, temperature=11)
    assert zenith == pytest.approx(50.11162, abs=1e-3)  # theirs stands at 1830 m
    assert azimuth == pytest.approx(194.34024, abs=1e-3)


def test_refraction_lifts_the_low_sun():
    low = {"latitude": 0.0, "longitude": 0.0, "time": "2026-03-20T06:12Z"}
    seen, true = sun.position(**low).zenith, sun.position(**low, refraction=False).zenith
    assert 85 < seen < 90
    assert 0.1 < true - seen < 0.6


def test_a_time_without_zone_is_utc_wherever_the_machine_stands(monkeypatch):
    monkeypatch.setenv("TZ", "Pacific/Auckland")
    time.tzset()
    aware = datetime(2026, 6, 21, 18, tzinfo=UTC)
    same = [
        "2026-06-21T18:00",
        "2026-06-21T18:00Z",
        "2026-06-21T20:00+02:00",
        aware,
        aware.replace(tzinfo=None),
    ]
    zeniths = sun.position(36.8, -122.0, same).zenith
    monkeypatch.undo()
    time.tzset()
    assert zeniths == pytest.approx(float(sun.position(36.8, -122.0, np.datetime64("2026-06-21T18:00")).zenith))


def test_broadcasts_places_against_times():
    latitudes = np.array([10.0, 20.0, 30.0])[:, None]
    zenith, azimuth = sun.position(latitudes, -30.0, TIMES)
    assert zenith.shape == azimuth.shape == (3, 4)
    assert zenith[1, 2] == pytest.approx(float(sun.position(20.0, -30.0, TIMES[2]).zenith))


@pytest.mark.parametrize(("place", "start"), [((36.8, -122.0), "2026-06-21T08:00"), ((-33.9, 18.4), "2026-01-05")])
def test_next_rise_against_pvlib(place, start):
    import pandas as pd
    import pvlib

    found = sun.next_rise(*place, start)
    noon = pd.DatetimeIndex([np.datetime64(found, "D")], tz="UTC")
    theirs = pvlib.solarposition.sun_rise_set_transit_spa(noon, *place)["sunrise"].iloc[0]
    late = pd.Timestamp(found, tz="UTC") - theirs
    assert 0 <= late.total_seconds() < 180  # theirs is when the upper limb shows
    assert sun.position(*place, found).zenith <= 90 < sun.position(*place, found - np.timedelta64(70, "s")).zenith


def test_in_the_polar_night_no_sun_rises():
    assert np.isnat(sun.next_rise(80.0, 0.0, "2026-12-21"))


@pytest.mark.parametrize("day", [1, 60, 172, 300])
def test_distance_against_spencer(day):
    import pvlib

    theirs = pvlib.irradiance.get_extra_radiation(day, solar_constant=1.0, method="spencer")
    assert sun.distance_factor(day) == pytest.approx(theirs, rel=3e-3)


def test_solid_angle_of_the_disk():
    half = np.arcsin(695_700 / 149_597_870.7)
    assert sun.solid_angle() == pytest.approx(2 * np.pi * (1 - np.cos(half)), rel=2e-4)
    assert sun.solid_angle(3) == pytest.approx(6.794e-5 * 1.0167**2)


def test_day_of_year():
    assert sun.day_of_year(["2024-01-01", "2024-12-31T12:00", "2025-03-01"]) == pytest.approx([1, 366.5, 60])


def test_refuses_what_is_no_time_or_place():
    with pytest.raises(InputError, match=r"^time .*like 2026-\S*Z.*'noon'"):
        sun.position(0, 0, "noon")
    with pytest.raises(InputError, match=r"^temperature .*-90 to 60.*Celsius.* 288"):
        sun.position(36.8, -122.0, "2026-06-21T18:00Z", temperature=288.0)
    with pytest.raises(InputError, match=r"^latitude .*-90 to 90 degrees.* 91"):
        sun.position(91, 0, "2026-06-21")
