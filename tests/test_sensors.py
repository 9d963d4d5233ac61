"""The table of sensors: complete, consistent, and found under the names people use."""

import math

import pytest

from deglint import sensors
from deglint.errors import InputError


@pytest.mark.parametrize("name", sensors.names())
def test_every_preset_is_complete_and_consistent(name):
    sensor = sensors.load(name)
    assert sensor.name == name
    assert sensor.title
    assert sensor.wavelength_status in ("verified", "unverified", "defined")
    if sensor.wavelength_status == "verified":
        assert sensor.sources
    for band in sensor.bands:
        assert 350 < band.wavelength < 2500
        assert 0 < band.width < 300
        assert (band.time_offset is None) == (band.time_status is None)
        assert band.answers_to(band.name)
    offsets = [b.time_offset for b in sensor.bands if b.time_offset is not None]
    assert not offsets or min(offsets) == 0


@pytest.mark.parametrize("name", sensors.names())
def test_names_and_aliases_of_bands_are_unambiguous(name):
    bands = sensors.load(name).bands
    seen = [sensors.normalise(n) for b in bands for n in dict.fromkeys(map(sensors.normalise, (b.name, *b.aliases)))]
    assert len(seen) == len(set(seen))


def test_aliases_of_presets_are_unambiguous():
    every = [sensors.normalise(n) for s in map(sensors.load, sensors.names()) for n in (s.name, *s.aliases)]
    assert len(every) == len(set(every))


@pytest.mark.parametrize(
    ("alias", "name"),
    [
        ("WorldView-3", "worldview3"),
        ("WV02", "worldview2"),
        ("PlanetScope", "planetscope8"),
        ("landsat 9", "landsat8"),
        ("S2B", "sentinel2"),
        ("RedEdge-MX", "micasense"),
    ],
)
def test_presets_are_found_as_people_write_them(alias, name):
    assert sensors.load(alias).name == name


def test_unknown_sensor_lists_the_choices():
    with pytest.raises(InputError, match=r"no sensor preset 'hubble'.*worldview2, .*thesis") as caught:
        sensors.load("hubble")
    assert "\n" not in str(caught.value)
    assert sensors.find("hubble") is None


@pytest.mark.parametrize("name", ["worldview2", "worldview3"])
def test_worldview_has_two_groups_of_four(name):
    groups = {b.name: b.group for b in sensors.load(name).bands}
    assert {n for n, g in groups.items() if g == "MS1"} == {"BLUE", "GREEN", "RED", "NIR1"}
    assert {n for n, g in groups.items() if g == "MS2"} == {"COASTAL", "YELLOW", "REDEDGE", "NIR2"}


def test_sentinel2_red_sees_the_ground_a_second_after_blue():
    bands = {b.name: b for b in sensors.load("sentinel2").bands}
    assert bands["B04"].time_offset - bands["B02"].time_offset == pytest.approx(1.005)
    assert {b.time_status for b in bands.values()} == {"verified"}


@pytest.mark.parametrize(
    ("name", "altitude", "ground"),
    [("worldview2", 770e3, 1.84), ("worldview3", 617e3, 1.24), ("sentinel2", 786e3, 10.0)],
)
def test_optics_give_the_known_ground_sample(name, altitude, ground):
    optics = sensors.load(name).optics
    assert optics.pixel_pitch * 1e-6 * altitude / optics.focal_length == pytest.approx(ground, rel=0.03)
    assert math.isclose(optics.f_number, optics.focal_length / optics.aperture, rel_tol=0.01)
