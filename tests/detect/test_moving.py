"""Boats that move between the bands."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from deglint import open_scene
from deglint.errors import InputError
from deglint.readers.grid import ground_area
from deglint.scene import Band, Scene
from detect.moving import find_moving
from detect.objects import find
from detect.pipeline.features import delayed_bands, motions

from ..common import SHARED, beside

DELAYS = np.array([0.0, 0.13, 0.27, 0.4])


def moving_scene(speed=0.0, heading=0.0, *, pixel=1.2, seed=0, waves=True):
    """Four bands of waves that move with their phase speed, a boat of 6 m x 3 m, and a buoy at rest."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:200, :220].astype(float)
    number = 2 * np.pi / 25  # waves of 25 m
    image = rng.normal(100, 2, (4, 200, 220))
    for band, time in enumerate(DELAYS):
        if waves:
            image[band] += 4 * np.sin(number * columns * pixel - np.sqrt(9.81 * number) * time)
        step = speed * time / pixel
        at = 90 - step * np.cos(np.radians(heading)), 110 + step * np.sin(np.radians(heading))
        for (row, column), high in ((at, 120.0 if speed else 0.0), ((40, 40), 90.0)):
            image[band] += high * np.exp(-(((rows - row) / 1.5) ** 2) - ((columns - column) / 1.5) ** 2)
    return image


@pytest.mark.parametrize("speed", [2.0, 5.0, 10.0, 15.0])
@pytest.mark.parametrize("heading", [0.0, 75.0, 230.0])
def test_speed_and_heading_of_a_boat(speed, heading):
    found = find_moving(moving_scene(speed, heading), DELAYS, pixel=1.2)
    assert len(found) == 1  # neither the buoy nor a wave
    assert found[0].speed == pytest.approx(speed, abs=0.6)
    assert (found[0].heading - heading + 180) % 360 - 180 == pytest.approx(0, abs=12)
    assert (found[0].row, found[0].column) == pytest.approx((90, 110), abs=0.5)


@pytest.mark.parametrize("shape", [(150, 220), (220,)])
def test_a_mask_of_another_shape_is_refused(shape):
    with pytest.raises(InputError, match="the mask has shape"):
        find_moving(moving_scene(), DELAYS, pixel=1.2, water=np.ones(shape, bool))


@pytest.mark.parametrize("seed", range(3))
def test_waves_are_no_boats(seed):
    assert not find_moving(moving_scene(seed=seed), DELAYS, pixel=1.2)


def real_swell():
    files = sorted((SHARED / "real" / "swell").glob("**/IMG_DATA/*_B0[24].jp2"))
    return [rasterio.open(f).read(1).astype(np.float32)[:, :470] for f in files]  # land lies farther east


@beside("real", "swell")
@pytest.mark.parametrize("step", [0.0, 0.5, 1.0, 2.0])
def test_real_swell_is_no_boat(step):
    """Both bands with their mean between them, and one band that moves as a whole by a step from band to band."""
    first, last = real_swell()
    water = (first > 0) & (last > 0)
    bands = [first, (first + last) / 2, last]
    if step:
        moves = [np.float32([[1, 0, k * step], [0, 1, k * step / 3]]) for k in range(3)]
        bands = [cv2.warpAffine(first, m, first.shape[::-1], borderMode=cv2.BORDER_REFLECT) for m in moves]
    assert not find_moving(np.stack(bands), [0.0, 0.5, 1.0], pixel=10.0, water=water)


@beside("real", "swell")
def test_two_bands_of_real_swell_are_refused():
    bands = real_swell()
    with pytest.raises(InputError, match="three bands"):  # two bands cannot distinguish a boat from a wave
        find_moving(np.stack(bands), [0.0, 1.0], pixel=10.0)


def test_where_motions_line_up_by_chance_none_is_told():
    rng = np.random.default_rng(0)
    image = rng.normal(100, 2, (3, 200, 220))
    for band in image:
        band[rng.integers(0, 200, 400), rng.integers(0, 220, 400)] += 60
    assert not find_moving(image, [0, 0.2, 0.4], pixel=1.2)


def test_a_boat_that_a_masked_array_hides_is_not_found():
    image = moving_scene(10.0, 75.0)
    hidden = np.zeros(image.shape, bool)
    hidden[:, 80:100, 100:120] = True
    assert find_moving(image, DELAYS, pixel=1.2)
    assert not find_moving(np.ma.array(image, mask=hidden), DELAYS, pixel=1.2)


def test_too_few_delays_and_pixels_of_no_size_are_refused():
    image = np.zeros((3, 10, 10))
    with pytest.raises(InputError, match="three bands"):
        find_moving(image, [0, 0, 1], pixel=1)
    with pytest.raises(InputError, match="a delay for each band"):
        find_moving(image, [0, 1], pixel=1)
    with pytest.raises(InputError, match="above 0 m"):
        find_moving(image, [0, 1, 2], pixel=0)


def test_objects_of_a_scene_get_speed_and_heading(tmp_path, write, rxdetect):
    image = moving_scene(10.0, 75.0)

    def describe(dataset):
        for i, time in enumerate(DELAYS, start=1):
            dataset.update_tags(i, time_offset_s=str(time))

    place = {"transform": from_origin(400_000, 800_000, 1.2, 1.2)}
    scene = write(tmp_path / "boat.tif", image.astype(np.float32), describe=describe, **place)
    marked = tmp_path / "o.geojson"
    options = ("--method", "sea", "--mask", "none", "--pfa", "1e-4", "--objects", marked, "--moving")
    ran = rxdetect("score", scene, tmp_path / "out.tif", *options)
    assert ran.code == 0, ran.err
    known = [f["properties"] for f in json.loads(marked.read_text())["features"]]
    boat = min(known, key=lambda p: np.hypot(p["row"] - 90, p["column"] - 112))
    assert boat["speed_m_s"] == pytest.approx(10, abs=0.6)
    assert boat["heading"] == pytest.approx(75, abs=5)
    buoy = min(known, key=lambda p: np.hypot(p["row"] - 40, p["column"] - 40))
    assert buoy["speed_m_s"] is None
    still = write(tmp_path / "still.tif", image.astype(np.float32), **place)
    ran = rxdetect("score", still, tmp_path / "out2.tif", *options, "--overwrite")
    assert (ran.code, "known, different times" in ran.err) == (1, True)


def test_only_the_boat_among_sparkle_has_a_speed(tmp_path, deglint, rxdetect):
    """Sparkle had speeds; and no boat had one after the removal, which leaves sparkle in the NIR and moves edges."""
    raw, clean, marked = (tmp_path / name for name in ("boat.tif", "clean.tif", "o.geojson"))
    named = ("--preset", "worldview3", "--wind", "3", "--size", "256", "--seed", "3", "--objects", "none")
    assert deglint("simulate", *named, "--boat", "100,100,6@60", raw.with_suffix("")).code == 0
    assert deglint("remove", raw, clean).code == 0
    for scene in (raw, clean):
        options = ("--moving", "--pfa", "1e-4", "--objects", marked, "--overwrite")
        ran = rxdetect("score", scene, tmp_path / "scores.tif", *options)
        assert ran.code == 0, ran.err
        known = [f["properties"] for f in json.loads(marked.read_text())["features"]]
        (boat,) = [p for p in known if p["speed_m_s"] is not None]
        assert len(known) > 2
        assert boat["speed_m_s"] == pytest.approx(6, abs=0.9)
        assert boat["heading"] == pytest.approx(60, abs=5)


@pytest.mark.slow
@pytest.mark.parametrize(("wind", "speed", "heading", "seed"), [(5, 4, 67, 31), (7, 8, 215, 35), (9, 12, 3, 39)])
def test_boats_in_rougher_seas(tmp_path, deglint, rxdetect, wind, speed, heading, seed):
    raw, marked = tmp_path / "boat.tif", tmp_path / "o.geojson"
    named = ("--preset", "worldview3", "--wind", str(wind), "--size", "300", "--seed", str(seed), "--objects", "none")
    assert deglint("simulate", *named, "--boat", f"150,150,{speed}@{heading}", raw.with_suffix("")).code == 0
    options = ("--moving", "--pfa", "1e-4", "--objects", marked)
    assert rxdetect("score", raw, tmp_path / "scores.tif", *options).code == 0
    known = [f["properties"] for f in json.loads(marked.read_text())["features"]]
    (boat,) = [p for p in known if p["speed_m_s"] is not None]
    assert boat["speed_m_s"] == pytest.approx(speed, abs=1.5)
    assert (boat["heading"] - heading + 180) % 360 - 180 == pytest.approx(0, abs=5)


@pytest.mark.parametrize(("heading", "speed"), [(90.0, 5.0), (0.0, 10.0)])
def test_speed_where_pixels_are_not_square(tmp_path, write, heading, speed):
    side = 1.2 / 111_412  # at 60 degrees north a pixel is 0.6 m wide and 1.2 m high
    place = {"crs": "EPSG:4326", "transform": from_origin(10, 60, side, side)}
    image = moving_scene(10.0, heading, waves=False).astype(np.float32)
    scene = open_scene(write(tmp_path / "boat.tif", image, **place))
    scene = replace(scene, bands=[Band(str(n), time_offset=time) for n, time in enumerate(DELAYS.tolist())])
    boat = find((image[0] > 150) & (np.arange(220) > 80), image[0])
    (found,) = motions(scene, range(4), ground_area(scene.transform, scene.crs, *scene.shape[1:]), boat)
    assert found["speed_m_s"] == pytest.approx(speed, rel=0.06)
    assert (found["heading"] + 180) % 360 - 180 == pytest.approx(heading, abs=5)


def test_times_that_are_equal_do_not_count_twice():
    scene = Scene(tuple(Band(str(n), time_offset=time) for n, time in enumerate((0.0, 0.0, 0.1, 0.1))), 9, 9, None)
    with pytest.raises(InputError, match=r"different times.* 2 differ"):
        delayed_bands(scene, range(4))
