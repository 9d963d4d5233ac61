"""Where on a scene: windows, GeoJSON in any CRS, and masks, by the rule of the pixel's centre."""

import json
import re
from itertools import pairwise

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin
from rasterio.warp import transform_geom

from deglint import open_scene
from deglint.errors import InputError, NoWaterError, ReadError
from deglint.readers.areas import open_area

HEIGHT, WIDTH = 80, 100
WHOLE = ((0, HEIGHT), (0, WIDTH))


def corner(row, column):
    """UTM of a place in pixels of the scenes of these tests."""
    return 400_000 + 10 * column, 800_000 - 10 * row


def ring(*places):
    return [corner(*p) for p in (*places, places[0])]


def centres_in(top, bottom, left, right):
    rows, columns = np.arange(HEIGHT)[:, None] + 0.5, np.arange(WIDTH)[None, :] + 0.5
    return (rows > top) & (rows < bottom) & (columns > left) & (columns < right)


@pytest.fixture
def scene(sea, write, tmp_path):
    return open_scene(write(tmp_path / "in.tif", sea(HEIGHT, WIDTH)))


def area_of(scene, text):
    return open_area(str(text), scene, "--sample")


BOX = ring((10.4, 20.4), (10.4, 60.6), (50.6, 60.6), (50.6, 20.4))
INSIDE = centres_in(10.4, 50.6, 20.4, 60.6)
CORNERS = (5.12, 5.34), (70.56, 10.78), (30.91, 90.23)


@pytest.mark.parametrize("text", ["20,10,41,41", " 20 , 10 , 41 , 41 "])
def test_a_window_is_column_row_width_height(scene, text):
    expected = np.zeros((HEIGHT, WIDTH), bool)
    expected[10:51, 20:61] = True
    np.testing.assert_array_equal(area_of(scene, text).read(WHOLE), expected)


def test_a_window_is_cut_to_the_scene(scene):
    assert area_of(scene, "-5,-5,10,10").read(WHOLE).sum() == 25


@pytest.mark.parametrize("kind", ["Polygon", "MultiPolygon", "GeometryCollection"])
def test_a_polygon_covers_the_pixels_whose_centres_lie_in_it(scene, geojson, tmp_path, kind):
    path = geojson(tmp_path / "a.geojson", BOX, crs="EPSG:32653", kind=kind)
    np.testing.assert_array_equal(area_of(scene, path).read(WHOLE), INSIDE)


def test_a_slanted_polygon_follows_the_rule_too(scene, geojson, tmp_path):
    path = geojson(tmp_path / "a.geojson", ring(*CORNERS), crs="EPSG:32653")
    rows, columns = np.arange(HEIGHT)[:, None] + 0.5, np.arange(WIDTH)[None, :] + 0.5

    def left_of(a, b):
        return (b[1] - a[1]) * (rows - a[0]) - (b[0] - a[0]) * (columns - a[1])

    sides = [left_of(a, b) for a, b in pairwise([*CORNERS, CORNERS[0]])]
    expected = np.logical_and.reduce([s > 0 for s in sides]) | np.logical_and.reduce([s < 0 for s in sides])
    np.testing.assert_array_equal(area_of(scene, path).read(WHOLE), expected)


@pytest.mark.parametrize("crs", [None, "urn:ogc:def:crs:OGC:1.3:CRS84", "EPSG:4326", "EPSG:3857", "EPSG:32652"])
def test_a_polygon_in_another_crs_is_brought_into_the_scenes(scene, geojson, tmp_path, crs):
    own = transform_geom("EPSG:32653", crs if crs and "CRS84" not in crs else "OGC:CRS84",
                         {"type": "Polygon", "coordinates": [BOX]})  # fmt: skip
    path = geojson(tmp_path / "a.geojson", own["coordinates"][0], crs=crs)
    np.testing.assert_array_equal(area_of(scene, path).read(WHOLE), INSIDE)


@pytest.mark.parametrize(
    "spelled",
    ["urn:ogc:def:crs:EPSG::32653", "urn:ogc:def:crs:EPSG:9.8:32653", "epsg:32653",
     "http://www.opengis.net/def/crs/EPSG/0/32653"],
)  # fmt: skip
def test_holes_and_a_ring_left_open_are_understood(scene, tmp_path, spelled):
    hole = ring((20.4, 30.4), (20.4, 40.6), (30.6, 40.6), (30.6, 30.4))
    document = {
        "type": "Polygon",
        "coordinates": [BOX[:-1], hole],
        "crs": {"type": "name", "properties": {"name": spelled}},
    }
    (tmp_path / "a.json").write_text(json.dumps(document))
    expected = INSIDE & ~centres_in(20.4, 30.6, 30.4, 40.6)
    np.testing.assert_array_equal(area_of(scene, tmp_path / "a.json").read(WHOLE), expected)


def test_without_a_crs_coordinates_are_the_scenes_own(sea, write, geojson, tmp_path):
    scene = open_scene(write(tmp_path / "b.tif", sea(HEIGHT, WIDTH), crs=None))
    path = geojson(tmp_path / "a.geojson", BOX)
    np.testing.assert_array_equal(area_of(scene, path).read(WHOLE), INSIDE)


def test_without_any_place_coordinates_are_pixels(sea, write, geojson, tmp_path):
    scene = open_scene(write(tmp_path / "b.tif", sea(HEIGHT, WIDTH), crs=None, transform=None))
    path = geojson(tmp_path / "a.geojson", [(20.4, 10.4), (60.6, 10.4), (60.6, 50.6), (20.4, 50.6)])
    np.testing.assert_array_equal(area_of(scene, path).read(WHOLE), INSIDE)


def test_windows_of_an_area_are_cut_out_of_the_whole_even_where_edges_run_through_centres(
    sea, write, geojson, tmp_path
):
    # 0.1 and 1/3 are no binary fractions: only always drawing the same squares keeps these ties the same
    step = 0.1 / 3
    scene = open_scene(write(tmp_path / "b.tif", np.zeros((4, 300, 700), np.uint8), crs="EPSG:4326",
                             transform=from_origin(134.123456789, 7.7654321, step, step)))  # fmt: skip
    places = [(x, y) for x, y in [(10.5, 3.5), (690.5, 50.5), (600.5, 280.5), (30.5, 299.5)]]
    points = [(134.123456789 + step * x, 7.7654321 - step * y) for x, y in places]
    area = area_of(scene, geojson(tmp_path / "a.geojson", points))
    whole = area.read(((0, 300), (0, 700)))
    assert 0 < whole.sum() < whole.size
    rng = np.random.default_rng(0)
    for _ in range(30):
        top, bottom = sorted(rng.choice(301, 2, replace=False).tolist())
        left, right = sorted(rng.choice(701, 2, replace=False).tolist())
        np.testing.assert_array_equal(area.read(((top, bottom), (left, right))), whole[top:bottom, left:right])


def test_an_area_off_the_scene_says_where_it_lies(scene, geojson, tmp_path):
    far = geojson(tmp_path / "a.geojson", ring((1000, 1000), (1010, 1000), (1010, 1010)), crs="EPSG:32653")
    with pytest.raises(InputError, match=r"rows 1000 to 1010.*80 rows.*100 columns"):
        area_of(scene, far)
    with pytest.raises(InputError, match="lies off the scene"):
        area_of(scene, "200,10,5,5")


HOSTILE = {
    "empty file": "",
    "no JSON": "{",
    "a list": "[]",
    "a number": "3",
    "null": "null",
    "no features": '{"type": "FeatureCollection", "features": []}',
    "features is a number": '{"type": "FeatureCollection", "features": 5}',
    "features of nonsense": '{"type": "FeatureCollection", "features": [1, null, "x", [], {}]}',
    "only points": '{"type": "Point", "coordinates": [1, 2]}',
    "geometry null": '{"type": "Feature", "geometry": null}',
    "coordinates null": '{"type": "Polygon", "coordinates": null}',
    "coordinates a number": '{"type": "Polygon", "coordinates": 5}',
    "coordinates a word": '{"type": "Polygon", "coordinates": "all of it"}',
    "coordinates an object": '{"type": "Polygon", "coordinates": {"a": 1}}',
    "empty ring": '{"type": "Polygon", "coordinates": [[]]}',
    "two corners": '{"type": "Polygon", "coordinates": [[[1, 2], [3, 4], [1, 2]]]}',
    "corners of one number": '{"type": "Polygon", "coordinates": [[[1], [2], [3], [1]]]}',
    "corners of words": '{"type": "Polygon", "coordinates": [[["a", "b"], ["c", "d"], ["e", "f"]]]}',
    "NaN": '{"type": "Polygon", "coordinates": [[[NaN, 1], [2, 2], [3, 1], [NaN, 1]]]}',
    "Infinity": '{"type": "Polygon", "coordinates": [[[Infinity, 1], [2, 2], [3, 1], [Infinity, 1]]]}',
    "out of this world": '{"type": "Polygon", "coordinates": [[[1e300, 1], [2e300, 2], [3, 1e300], [1e300, 1]]]}',
    "a huge integer": '{"type": "Polygon", "coordinates": [[[' + "9" * 400 + ", 1], [2, 2], [3, 1]]]}",
    "MultiPolygon of nonsense": '{"type": "MultiPolygon", "coordinates": [1, 2]}',
    "MultiPolygon is a word": '{"type": "MultiPolygon", "coordinates": "x"}',
    "unknown crs": '{"type": "Polygon", "coordinates": [[[1, 2], [2, 2], [3, 1]]],'
    ' "crs": {"type": "name", "properties": {"name": "EPSG:999999"}}}',
    "a file as crs": '{"type": "Polygon", "coordinates": [[[1, 2], [2, 2], [3, 1]]],'
    ' "crs": {"type": "name", "properties": {"name": "/etc/hostname"}}}',
    "deep nesting": '{"type": "GeometryCollection", "geometries": [' * 5000 + "]}" * 5000,
    "very deep nesting": "[" * 200_000,
    "not text": "\udcff\udcfe\x00",
}


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_geojson_is_refused_in_one_line(scene, tmp_path, text):
    (tmp_path / "a.geojson").write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(InputError) as refused:
        area_of(scene, tmp_path / "a.geojson")
    assert "a.geojson" in str(refused.value)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 600


def test_nesting_that_json_can_hold_is_followed(scene, tmp_path):
    inner = json.dumps({"type": "Polygon", "coordinates": [BOX]})
    deep = '{"type": "GeometryCollection", "geometries": [' * 400 + inner + "]}" * 400
    document = f'{{"crs": {{"properties": {{"name": "EPSG:32653"}}}}, "geometries": [{deep}]}}'
    (tmp_path / "a.geojson").write_text(document)
    np.testing.assert_array_equal(area_of(scene, tmp_path / "a.geojson").read(WHOLE), INSIDE)


def test_a_directory_is_not_read(scene, tmp_path):
    (tmp_path / "d.geojson").mkdir()
    with pytest.raises(ReadError, match="cannot read"):
        area_of(scene, tmp_path / "d.geojson")


def mask_array():
    return (INSIDE * np.uint8(7))[None]


@pytest.mark.parametrize("place", [{}, {"crs": None}, {"crs": None, "transform": None}])
def test_a_mask_of_the_scenes_size(scene, write, tmp_path, place):
    path = write(tmp_path / "m.tif", mask_array(), names=None, **place)
    np.testing.assert_array_equal(area_of(scene, path).read(WHOLE), INSIDE)


def test_nodata_of_a_mask_is_outside(scene, write, tmp_path):
    values = np.where(INSIDE, 7, 255).astype(np.uint8)[None]
    np.testing.assert_array_equal(area_of(scene, write(tmp_path / "m.tif", values, nodata=255)).read(WHOLE), INSIDE)
    floats = np.where(INSIDE, 1, np.nan).astype(np.float32)[None]
    np.testing.assert_array_equal(area_of(scene, write(tmp_path / "n.tif", floats)).read(WHOLE), INSIDE)


def test_a_mask_on_a_finer_grid_is_taken_at_the_pixels_centres(scene, write, tmp_path):
    fine = np.kron(mask_array()[0, 5:75, 10:90], np.ones((4, 4), np.uint8))[None]
    place = from_origin(*corner(5, 10), 2.5, 2.5)
    np.testing.assert_array_equal(area_of(scene, write(tmp_path / "m.tif", fine, transform=place)).read(WHOLE), INSIDE)


def test_a_mask_that_covers_part_of_the_scene(scene, write, tmp_path):
    part = mask_array()[:, :40, :50]
    expected = INSIDE.copy()
    expected[40:], expected[:, 50:] = False, False
    for name, options in (("a", {}), ("b", {"nodata": 255}), ("c", {"nodata": 0}), ("d", {"mask": part[0] * 36})):
        area = area_of(scene, write(tmp_path / f"{name}.tif", part, names=None, **options))
        np.testing.assert_array_equal(area.read(WHOLE), expected, err_msg=name)


def test_a_mask_in_another_crs_is_reprojected(scene, write, tmp_path):
    with rasterio.open(tmp_path / "in.tif") as dataset:
        west, south, east, north = rasterio.warp.transform_bounds(dataset.crs, "EPSG:4326", *dataset.bounds)
    step = 2e-5
    shape = int((north - south) / step), int((east - west) / step)
    box = transform_geom("EPSG:32653", "EPSG:4326", {"type": "Polygon", "coordinates": [BOX]})
    place = from_origin(west, north, step, step)
    drawn = rasterio.features.rasterize([box], shape, transform=place)[None]
    path = write(tmp_path / "m.tif", drawn.astype(np.uint8), crs="EPSG:4326", transform=place)
    found = area_of(scene, path).read(WHOLE)
    assert (found != INSIDE).sum() <= 20  # of 164 pixels along the edge; the mask's own pixels are a fifth of one
    np.testing.assert_array_equal(area_of(scene, path).read(((11, 50), (21, 60))), True)


@pytest.mark.parametrize("place", [from_origin(500_000, 800_000, 10, 10), from_origin(400_000, 900_000, 10, 10)])
def test_a_mask_beside_the_scene_is_refused(scene, write, tmp_path, place):
    with pytest.raises(InputError, match=r"--sample .*m\.tif.*off the scene.*Check its CRS"):
        area_of(scene, write(tmp_path / "m.tif", mask_array(), transform=place))


@pytest.mark.parametrize(("west", "held"), [(-180, 1.0), (0, 0.14)])  # from 0 to 360, not beyond 180 degrees
def test_a_mask_of_the_whole_earth_holds_a_scene_across_180_degrees(sea, write, tmp_path, west, held):
    across = from_origin(829_000, 1_000_000, 10, 10)  # of UTM zone 60: 180 degrees run through it
    scene = open_scene(write(tmp_path / "in.tif", sea(HEIGHT, 600), crs="EPSG:32660", transform=across))
    earth = write(
        tmp_path / "m.tif", np.ones((1, 18, 36), np.uint8), crs="EPSG:4326", transform=from_origin(west, 90, 10, 10)
    )
    assert area_of(scene, earth).read(((0, HEIGHT), (0, 600))).mean() == pytest.approx(held, abs=0.01)


def test_a_mask_of_another_size_without_crs_is_refused(scene, write, tmp_path):
    path = write(tmp_path / "m.tif", mask_array()[:, 1:], crs=None)
    with pytest.raises(InputError, match=r"79 x 100.*scene 80 x 100"):
        area_of(scene, path)


def test_an_area_without_a_pixel_is_refused(scene, write, geojson, tmp_path):
    speck = geojson(tmp_path / "speck.geojson", ring((5.6, 5.6), (5.6, 5.9), (5.9, 5.9)), crs="EPSG:32653")
    for empty in (write(tmp_path / "m.tif", np.zeros_like(mask_array())), speck):
        for option, kind in (("--sample", InputError), ("--mask", NoWaterError)):
            with pytest.raises(kind, match=rf"{option} .*(m.tif|speck.geojson).*no pixel") as error:
                open_area(str(empty), scene, option)
            assert type(error.value) is kind


def test_a_mask_of_several_bands_is_refused(scene, write, tmp_path):
    path = write(tmp_path / "m.tif", np.repeat(mask_array(), 3, axis=0))
    with pytest.raises(InputError, match=r"--sample .*m\.tif.*3 bands, not one"):
        area_of(scene, path)


def test_a_name_that_is_nothing_is_said(scene, tmp_path):
    with pytest.raises(ReadError, match="no such file"):
        area_of(scene, tmp_path / "m.tif")
    (tmp_path / "m.shp").write_text("not a raster")
    with pytest.raises(ReadError, match="not a raster"):
        area_of(scene, tmp_path / "m.shp")


def test_coordinates_without_a_crs_that_lie_in_the_scene_are_in_its_crs(scene, geojson, tmp_path, caplog):
    with caplog.at_level("INFO", "deglint"):
        found = open_area(geojson(tmp_path / "a.geojson", BOX), scene, "--mask")
    np.testing.assert_array_equal(found.read(WHOLE), INSIDE)
    assert caplog.messages == [found.note]
    assert "names no CRS" in found.note


@pytest.mark.parametrize("crs", [None, "EPSG:32653"])
def test_coordinates_that_lie_elsewhere_are_refused(scene, geojson, tmp_path, crs):
    path = geojson(tmp_path / "a.geojson", [(x + 1e5, y) for x, y in BOX], crs=crs)
    with pytest.raises(InputError, match=r"off the scene.*Check the CRS"):
        open_area(path, scene, "--mask")


@pytest.mark.parametrize("text", ["10,10,100", "1,2,3,4,5", "10,10,0,5", "1.5,2,3,4", "-3,", " 1, 2, 3 "])
def test_a_window_that_is_none_is_refused_with_one_that_is(scene, text):
    with pytest.raises(InputError, match=r"four integers.*column,row,width,height") as raised:
        open_area(text, scene, "--sample")
    window = re.search(r"such as --sample ([\d,]+), ", str(raised.value))[1]
    assert open_area(window, scene, "--sample").read(WHOLE).any()


def test_what_was_assumed_of_an_area_stands_in_the_sidecar(sea, write, geojson, deglint, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    box = [(400_100, 799_900), (400_100, 799_400), (400_700, 799_400), (400_700, 799_900)]
    drawn = geojson(tmp_path / "a.geojson", box)
    call = ("--sample", drawn, "--mask", drawn, "--method", "hedley", "--compensate", "off")
    ran = deglint("remove", source, tmp_path / "out.tif", *call)
    assert ran.code == 0, ran.err
    said = json.loads((tmp_path / "out.tif.json").read_text())
    assert "the CRS of the scene is assumed" in said["sample"]["crs"]
    assert any("the CRS of the scene is assumed" in note for note in said["notes"])
