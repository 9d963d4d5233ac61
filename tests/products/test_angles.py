"""Where sun and sensor stand, from the metadata of each family: what the modelled sky glint needs."""

import json
import math

import pytest

import deglint
from deglint.errors import InputError
from deglint.pipeline.flags import sky_glint
from deglint.readers.products.metadata import view_tags

NAMES = ("sun_elevation", "sun_azimuth", "view_elevation", "view_azimuth")
TILE = """<n1:Level-2A_Tile_ID xmlns:n1="https://psd-14.sentinel2.eo.esa.int/PSD/Tile.xsd"><n1:Geometric_Info><Tile_Angles>
<Sun_Angles_Grid><Zenith><Values_List><VALUES>1 2</VALUES></Values_List></Zenith></Sun_Angles_Grid>
<Mean_Sun_Angle><ZENITH_ANGLE unit="deg">30.5</ZENITH_ANGLE><AZIMUTH_ANGLE unit="deg">150.25</AZIMUTH_ANGLE>
</Mean_Sun_Angle><Mean_Viewing_Incidence_Angle_List>{}</Mean_Viewing_Incidence_Angle_List>
</Tile_Angles></n1:Geometric_Info></n1:Level-2A_Tile_ID>"""
VIEW = """<Mean_Viewing_Incidence_Angle bandId="{}"><ZENITH_ANGLE unit="deg">{}</ZENITH_ANGLE>
<AZIMUTH_ANGLE unit="deg">{}</AZIMUTH_ANGLE></Mean_Viewing_Incidence_Angle>"""


def angles_of(path):
    """Angles in the tags of a scene, in the order of NAMES, and the scene."""
    scene = deglint.open_scene(path)
    tags = scene.source.info.tags[""]
    return [float(tags[name]) if name in tags else None for name in NAMES], scene


def edit(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def with_tile(make, sea, folder, *views):
    safe = make.sentinel2(folder, sea())
    granule = next((safe / "GRANULE").iterdir())
    text = TILE.format("".join(VIEW.format(i, *v) for i, v in enumerate(views)))
    (granule / "MTD_TL.xml").write_text(text)
    return safe


def test_sentinel2_takes_the_mean_direction_of_the_bands(make, sea, tmp_path):
    safe = with_tile(make, sea, tmp_path, (8.0, 350.0), (8.0, 10.0))  # the mean azimuth is north, not south
    found, scene = angles_of(safe)
    zenith = math.degrees(math.atan(math.tan(math.radians(8.0)) * math.cos(math.radians(10.0))))
    assert found == pytest.approx([59.5, 150.25, 90.0 - zenith, 0.0], abs=1e-4)
    assert set(sky_glint(scene)["reflectance"]) >= {"B02", "B08"}
    band = next(safe.rglob("*B08_10m.jp2"))
    assert angles_of(band)[0] == found
    between = angles_of(with_tile(make, sea, tmp_path / "between", (10.0, 90.0), (60.0, 90.0)))[0]
    assert between[2:] == pytest.approx([90.0 - 35.0, 90.0], abs=1e-4)


@pytest.mark.parametrize("text", ["<not xml", "<Tile/>"])
def test_a_tile_file_without_angles_costs_them_alone_and_a_damaged_one_is_named(make, sea, tmp_path, text):
    safe = with_tile(make, sea, tmp_path)
    next(safe.rglob("MTD_TL.xml")).write_text(text)
    if text != "<Tile/>":
        with pytest.raises(InputError, match=r"MTD_TL\.xml.*damaged.*Download"):
            angles_of(safe)
        return
    found, scene = angles_of(safe)
    assert found == [None] * 4
    assert sky_glint(scene) is None


@pytest.mark.parametrize(("roll", "view"), [("-0.001", (89.9989, 0.0)), ("14.9", (73.4, None)), (None, (None, None))])
def test_landsat_looks_down_or_is_rolled(make, sea, tmp_path, roll, view):
    folder = make.landsat(tmp_path, sea())
    if roll:
        edit(next(folder.glob("*_MTL.txt")), "    SUN_AZIMUTH", f"    ROLL_ANGLE = {roll}\n    SUN_AZIMUTH")
    found, scene = angles_of(folder)
    assert found[:2] == pytest.approx([50.0, 137.0193], abs=1e-4)
    assert found[2:] == [None if v is None else pytest.approx(v, abs=0.05) for v in view]
    assert (sky_glint(scene) is not None) == (roll == "-0.001")


def test_planetscope_has_the_azimuth_from_its_json(make, sea, tmp_path):
    folder = make.planetscope(tmp_path, sea())
    edit(next(folder.glob("*.xml")), "<ps:acquisitionDateTime>",
         '<opt:illuminationAzimuthAngle uom="deg">120.5</opt:illuminationAzimuthAngle><ps:azimuthAngle uom="deg">12.04'
         '</ps:azimuthAngle><ps:spaceCraftViewAngle uom="deg">-3.0</ps:spaceCraftViewAngle>'
         "<eop:incidenceAngle>3.2</eop:incidenceAngle><ps:acquisitionDateTime>")  # fmt: skip
    assert angles_of(folder)[0] == [51.3, 120.5, 86.8, None]  # azimuthAngle is that of the image's lines
    facts = {"id": make.PLANET, "properties": {"satellite_azimuth": 281.4, "view_angle": 3.0, "sun_azimuth": 999}}
    next(folder.glob("*.json")).write_text(json.dumps(facts))
    found, scene = angles_of(folder)
    assert found == [51.3, 120.5, 86.8, 281.4]
    assert sky_glint(scene) is not None
    next(folder.glob("*.xml")).unlink()
    assert angles_of(folder)[0][2:] == pytest.approx([90 - 3.236, 281.4], abs=1e-3)


GEOMETRY = """<Located_Geometric_Values><LOCATION_TYPE>{0}</LOCATION_TYPE><Acquisition_Angles>
<AZIMUTH_ANGLE unit="deg">{1}</AZIMUTH_ANGLE><VIEWING_ANGLE_ACROSS_TRACK unit="deg">1</VIEWING_ANGLE_ACROSS_TRACK>
<VIEWING_ANGLE unit="deg">18</VIEWING_ANGLE><INCIDENCE_ANGLE_ALONG_TRACK unit="deg">{2}</INCIDENCE_ANGLE_ALONG_TRACK>
<INCIDENCE_ANGLE_ACROSS_TRACK unit="deg">{3}</INCIDENCE_ANGLE_ACROSS_TRACK>
<INCIDENCE_ANGLE unit="deg">{4}</INCIDENCE_ANGLE></Acquisition_Angles><Solar_Incidences>
<SUN_AZIMUTH unit="deg">152.5</SUN_AZIMUTH><SUN_ELEVATION unit="deg">60.5</SUN_ELEVATION></Solar_Incidences>
</Located_Geometric_Values>"""


@pytest.mark.parametrize(
    ("along", "across", "azimuth"), [(12.0, 0.0, 190.0), (0.0, 12.0, 100.0), (-12.0, 0.0, 10.0), (0.0, -12.0, 280.0)]
)
def test_dimap_turns_the_azimuth_of_the_lines_to_the_satellite(vendor, sea, tmp_path, along, across, azimuth):
    folder = vendor.dimap(tmp_path, sea())
    dim = next(folder.rglob("DIM*_MS_*.XML"))
    assert angles_of(folder)[0] == [61.0, 152.0, 77.5, None]
    edit(dim, "<Use_Area>", "<Use_Area>" + GEOMETRY.format("Center", 190.0, along, across, 12.25))
    edit(dim, "<Use_Area>", "<Use_Area>" + GEOMETRY.format("Top Center", 191.0, 5.0, 5.0, 12.3))
    found, scene = angles_of(folder)
    assert found == pytest.approx([60.5, 152.5, 77.75, azimuth])
    assert sky_glint(scene) is not None


def test_stac_items_state_angles(write, sea, tmp_path):
    write(tmp_path / "a.tif", sea())
    bands = [{"name": n, "eo:center_wavelength": w} for n, w in zip("BGRN", (0.49, 0.56, 0.66, 0.84), strict=True)]
    asset = {"href": "a.tif", "type": "image/tiff", "roles": ["data"], "bands": bands}
    sun = {"view:sun_elevation": 51.5, "view:sun_azimuth": 133.0}
    views = (
        ({"view:incidence_angle": 9.5, "view:off_nadir": 8.7, "view:azimuth": 284.0}, [80.5, 284.0]),
        ({"view:off_nadir": 20.0, "view:azimuth": 100.0}, [90 - 21.97, 100.0]),
        ({"view:off_nadir": 0}, [90.0, 0.0]),
        ({"view:off_nadir": "much", "view:azimuth": None}, [None, None]),
    )
    for facts, view in views:
        item = {"type": "Feature", "id": "a", "properties": sun | facts, "assets": {"image": asset}}
        (tmp_path / "a.json").write_text(json.dumps(item))
        found, scene = angles_of(tmp_path / "a.json")
        assert found == pytest.approx([51.5, 133.0, *view], abs=0.01)
        assert (sky_glint(scene) is not None) == (view[0] is not None)


def test_angles_at_the_satellite_are_smaller_than_on_the_ground():
    for off_nadir, altitude, incidence in ((0.0, 7e5, 0.0), (20.0, 7e5, 22.3), (30.0, 6e5, 33.2)):
        found = view_tags(None, -90.0, -off_nadir, altitude)
        assert found["view_elevation"] == pytest.approx(90 - incidence, abs=0.1)
        assert found["view_azimuth"] == 270.0
    assert view_tags(None, None, 80.0)["view_elevation"] is None  # looks past the Earth
