"""How large pixels are on the ground, whatever the map projection says of them."""

import json
import math

import numpy as np
import pytest
from rasterio.crs import CRS
from rasterio.transform import Affine, from_origin
from rasterio.warp import transform

from deglint.readers import open_scene
from deglint.readers.grid import ground_area, ground_size, pixel_size


@pytest.mark.parametrize(
    ("crs", "latitude", "longitude"),
    [(c, at, 23.6) for c in ("EPSG:3857", "EPSG:4326") for at in (0.0, 37.9, -60.0)] + [("EPSG:2263", 40.7, -74.0)],
)
def test_pixels_are_as_large_as_on_the_ground(crs, latitude, longitude):
    (x,), (y,) = transform("OGC:CRS84", crs, [longitude], [latitude])
    step = {"EPSG:3857": 10.0, "EPSG:4326": 1e-4, "EPSG:2263": 10 / 0.3048}[crs]  # the last is in feet
    sides = ground_size(from_origin(x - 50 * step, y + 50 * step, step, step), CRS.from_string(crs), 100, 100)
    on_sphere = math.cos(math.radians(latitude))
    degree = 111_320.0 * 1e-4
    wanted = {"EPSG:3857": (10 * on_sphere,) * 2, "EPSG:4326": (degree * on_sphere, degree), "EPSG:2263": (10.0, 10.0)}
    assert sides == pytest.approx(wanted[crs], rel=0.007)


def test_a_projection_that_is_nearly_true_is_taken_at_its_word():
    utm = CRS.from_epsg(32653)
    assert ground_size(from_origin(4e5, 8e5, 10, 10), utm, 80, 100) == (10, 10)
    turned = Affine(math.cos(0.5), -math.sin(0.5), 5e5, math.sin(0.5), math.cos(0.5), 1e6)
    assert ground_size(turned, utm, 80, 100) == pytest.approx((1, 1))
    assert ground_area(from_origin(4e5, 8e5, 10, 10), utm, 80, 100) == 100
    assert ground_size(from_origin(0, 0, 1, 1), None, 8, 8) is None
    assert ground_size(from_origin(0, 1e12, 1, 1), CRS.from_epsg(3857), 8, 8) is None


def test_areas_of_pixels():
    utm, us_feet, degrees = CRS.from_epsg(32653), CRS.from_epsg(2263), CRS.from_epsg(4326)
    assert ground_area(from_origin(4e5, 8e5, 10, 5), utm, 9, 9) == 50
    assert ground_area(from_origin(1e6, 2e5, 1, 1), us_feet, 9, 9) == pytest.approx(0.3048006**2, rel=1e-6)
    at_60 = ground_area(from_origin(10, 60.005, 0.001, 0.001), degrees, 10, 10)
    assert at_60 == pytest.approx(111.41 * 55.8, rel=1e-3)  # a degree of latitude and of longitude there: tables
    assert ground_area(None, utm, 9, 9) is None


def test_a_scene_in_web_mercator(deglint, sea, write, tmp_path):
    at = {"crs": "EPSG:3857", "transform": from_origin(2.6e6, 8_399_737.9 + 400, 10, 10)}  # 60 degrees north
    path = write(tmp_path / "a.tif", sea(), **at)
    assert pixel_size(open_scene(path)) == pytest.approx(5.0, rel=0.01)
    assert json.loads(deglint("info", path, "--json").out)["pixel_size"] == pytest.approx([5, 5], rel=0.01)
    assert "x 5.0" in deglint("info", path).out
    nowhere = write(tmp_path / "b.tif", np.zeros((1, 4, 5), np.uint8), crs=None, transform=Affine.identity())
    assert pixel_size(open_scene(nowhere)) is None


def test_without_coordinates_pixels_have_the_nominal_size_of_the_satellite(write, tmp_path):
    image, nowhere = np.ones((4, 8, 9), np.uint16), {"crs": None, "transform": Affine.identity()}
    drone = write(tmp_path / "a.tif", image, **nowhere, names=["Blue", "Green", "Red", "NIR"])
    satellite = write(tmp_path / "b.tif", image, **nowhere, names=["B02", "B03", "B04", "B08"])
    assert pixel_size(open_scene(drone)) is None
    assert pixel_size(open_scene(satellite)) == 10
    local = write(tmp_path / "c.tif", image, crs=None, names=["B02", "B03", "B04", "B08"])
    assert open_scene(local).transform is not None
    assert pixel_size(open_scene(local)) == 10
    assert pixel_size(open_scene(drone, sensor="planetscope4")) == 3
    bands = [f'{{ name = "{n}", wavelength = {w} }}' for n, w in (("Blue", 475), ("Green", 560), ("NIR", 842))]
    own = tmp_path / "own.toml"
    own.write_text(f'[own]\ntitle = "Own"\npixel = 0.05\nbands = [{", ".join(bands)}]\n')
    assert pixel_size(open_scene(drone, sensor=str(own))) == 0.05
