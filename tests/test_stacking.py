"""What went in comes out: files of one band, and STAC Items, become scenes that every next command knows."""

import json
from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from deglint.errors import InputError
from deglint.pipeline import Recipe, remove_glint
from deglint.readers import find_nir, open_scene
from deglint.readers.scenes import list_scenes

from .common import RUN, SENTINEL2, SHARED, beside


@pytest.fixture
def files(tmp_path, write, sea):
    """Four files of one band without names, each with its wavelength in its own tags and a unit."""
    made = []
    for code, band, wavelength in zip(SENTINEL2, sea(), (492, 560, 665, 833), strict=True):

        def describe(dataset, wavelength=wavelength):
            dataset.update_tags(WAVELENGTH=f"{wavelength} nm", FULL_SCALE=f"{wavelength}")
            dataset.units = ("DN",)

        made.append(write(tmp_path / f"T31_2020_{code}_10m.tif", band[None], names=(), describe=describe))
    return made


def said_of(path):
    with rasterio.open(path) as dataset:
        tags = [dataset.tags(i) for i in dataset.indexes]
        return dataset.descriptions, [t.get("wavelength_nm") for t in tags], dataset.units


def test_stacked_files_say_names_wavelengths_and_units(deglint, files, tmp_path):
    out = tmp_path / "out.tif"
    scene = open_scene(files)
    assert [b.saturation for b in scene.bands] == [492, 560, 665, 833]
    ran = deglint("remove", *files, out, *RUN)
    assert ran.code == 0, ran.err
    assert said_of(out) == (SENTINEL2, ["492", "560", "665", "833"], ("DN",) * 4)
    known = json.loads(deglint("info", out, "--json").out)
    assert [b["wavelength"] for b in known["bands"]] == [492, 560, 665, 833]
    assert known["nir"] == ["B08"]


def test_files_on_both_sides_of_180_degrees_are_stacked(write, tmp_path):
    seven = np.full((1, 300, 300), 7, np.uint16)
    fine = write(tmp_path / "a.tif", seven, crs="EPSG:4326", transform=from_origin(179.995, 9.03, 1e-4, 1e-4))
    zone60 = write(tmp_path / "b.tif", seven, crs="EPSG:32660", transform=from_origin(828_000, 1_001_000, 20, 20))
    scene = open_scene([fine, zone60])
    assert scene.notes[0].endswith("resampled (bilinear) to the grid of " + fine)
    assert (scene.read() == 7).all()


def test_files_in_degrees_a_turn_apart_are_refused(write, tmp_path):  # GDAL does not shift one onto the other
    seven = np.full((1, 300, 300), 7, np.uint16)
    east, west = (
        write(tmp_path / f"{left}.tif", seven, crs="EPSG:4326", transform=from_origin(left, 9.03, 1e-4, 1e-4))
        for left in (179.995, -180.005)
    )
    with pytest.raises(InputError, match="do not overlap"):
        open_scene([east, west])


@pytest.mark.parametrize("option", [("-b", "B02"), ("--mask", "water"), ("--method", "residual", "--nir", "B08")])
def test_the_next_command_knows_the_bands_of_a_stack(rxdetect, files, tmp_path, option):
    remove_glint(files, tmp_path / "out.tif", Recipe(method="hedley", sample="all", mask="none"))
    ran = rxdetect("score", tmp_path / "out.tif", tmp_path / "scores.tif", *option)
    assert ran.code == 0, ran.err


def test_a_stack_says_its_bands_where_nothing_is_corrected_too(deglint, write, sea, tmp_path):
    path = write(tmp_path / "a.tif", sea(512, 512), names=(), tiled=True, blockxsize=256, blockysize=256)
    out = tmp_path / "out.tif"
    ran = deglint("remove", path, out, "--bands", "blue,green,red,nir", "--wavelengths", "475,560,668,842", *RUN)
    assert ran.code == 0, ran.err
    assert said_of(out)[:2] == (("blue", "green", "red", "nir"), ["475", "560", "668", "842"])


@pytest.mark.slow
def test_a_batch_of_stacks_names_them(deglint, files, tmp_path):
    (tmp_path / "r.toml").write_text(
        '[recipe]\nmethod = "hedley"\nsample = "all"\nmask = "none"\n[input]\nbands = "blue,green,red,nir"\n'
        "wavelengths = [475, 560, 668, 842]\nscale = 1e-4\noffset = [0, 0, 0, -0.1]\n"
        f'[output]\ndirectory = "{tmp_path}/out"\n'
    )
    (tmp_path / "list.csv").write_text(f"name,path\none,{';'.join(files)}\n")
    ran = deglint("batch", tmp_path / "r.toml", tmp_path / "list.csv", "-q")
    assert ran.code == 0, ran.err + ran.out
    out = tmp_path / "out" / "one_deglinted.tif"
    assert said_of(out)[:2] == (("blue", "green", "red", "nir"), ["475", "560", "668", "842"])
    with rasterio.open(out) as dataset:
        assert (dataset.scales, dataset.offsets) == ((1e-4,) * 4, (0, 0, 0, -0.1))


# STAC


def item_of(files, *, new=False, **properties):
    """An Item as catalogues have it: bands in files of their own, a picture, and a band in two formats."""
    assets = {"visual": {"href": "v.tif", "type": "image/tiff", "roles": ["visual"], "eo:bands": [{"name": "red"}] * 3}}
    for key, path, common, wave in zip(
        ("b2", "b3", "b4", "b8"), files, ("blue", "green", "red", "nir"), (0.49, 0.56, 0.665, 0.842), strict=True
    ):
        eo = {"name": key.upper(), "common_name": common, "center_wavelength": wave, "full_width_half_max": 0.03}
        raster = {"scale": 0.0001, "offset": -0.1, "nodata": 7, "unit": "1"}
        if new:
            said = {"bands": [{k if k == "name" else f"eo:{k}": v for k, v in eo.items()}]}
            said |= {"raster:scale": 0.0001, "raster:offset": -0.1, "nodata": 7, "unit": "1"}
        else:
            said = {"eo:bands": [eo], "raster:bands": [raster]}
        assets[f"{key}-jp2"] = {"href": "s3://x/y.jp2", "type": "image/jp2", "roles": ["data"], **said}
        assets[key] = {"href": Path(path).name, "type": "image/tiff; application=geotiff", "roles": ["data"], **said}
    facts = {"platform": "sentinel-2b", "datetime": "2020-01-01T00:00:00Z", **properties}
    return {"type": "Feature", "stac_version": "1.0.0", "id": "tile 7", "assets": assets, "properties": facts}


@pytest.mark.parametrize("new", [False, True])
def test_a_stac_item_is_a_scene(deglint, files, tmp_path, new):
    (tmp_path / "item.json").write_text(json.dumps(item_of(files, new=new)))
    scene = open_scene(tmp_path / "item.json")
    assert scene.names == ("B2", "B3", "B4", "B8")
    assert scene.sensor == "sentinel2"
    assert find_nir(scene) == (3,)
    info = scene.source.info
    assert (info.scales, info.offsets, info.nodatas) == ((1e-4,) * 4, (-0.1,) * 4, (7,) * 4)
    with rasterio.open(files[0]) as dataset:
        np.testing.assert_allclose(scene.read()[0], dataset.read(1) * 1e-4 - 0.1, atol=1e-6)
    out = tmp_path / "out.tif"
    ran = deglint("remove", tmp_path / "item.json", out, *RUN)
    assert ran.code == 0, ran.err
    assert said_of(out)[0] == ("B2", "B3", "B4", "B8")
    assert json.loads(deglint("info", out, "--json").out)["sensor"] == "sentinel2"
    ran = deglint("info", tmp_path / "item.json", "-vv")
    assert ran.code == 0, ran.err


def test_units_that_may_differ_are_told(deglint, sea, write, tmp_path):
    raw = sea()
    counts = write(tmp_path / "a_B03.tif", raw[:1])
    reflectance = write(tmp_path / "a_B08.tif", raw[3:].astype(np.float32) / 10_000)
    told = "assumed to have the same unit"
    assert told in deglint("info", counts, reflectance).out
    assert told not in deglint("info", counts, write(tmp_path / "b_B08.tif", raw[3:])).out


@pytest.mark.parametrize("scale", [0.0, np.nan])
def test_a_scale_that_cannot_be_is_refused(deglint, sea, write, tmp_path, scale):
    path = write(tmp_path / "a.tif", sea(), describe=lambda dataset: setattr(dataset, "scales", [scale] * 4))
    said = deglint("info", path)
    assert (said.code, "--scale 1" in said.err) == (1, True)
    assert deglint("info", path, "--scale", "1", "--offset", "0").code == 0


@pytest.mark.parametrize("place", ["asset", "band"])
def test_of_several_pixel_sizes_of_a_band_the_finest_is_opened(files, tmp_path, place):
    item = item_of(files)
    assets = {}
    for key, asset in item["assets"].items():
        for size in (60, 20, 10):
            one = json.loads(json.dumps(asset))
            stated = one if place == "asset" else one.get("raster:bands", [{}])[0]
            stated |= {"gsd": size} if place == "asset" else {"spatial_resolution": size}
            one["href"] = one["href"] if size == 10 else f"{size}m_{one['href']}"
            assets[f"{key}_{size}m"] = one
    item["assets"] = assets
    (tmp_path / "item.json").write_text(json.dumps(item))
    (listed,) = list_scenes([str(tmp_path / "item.json")])
    assert listed.paths == tuple(files)


@pytest.mark.parametrize("centre", [True, False])
def test_bands_that_only_have_common_names_are_opened_once(files, tmp_path, centre):
    item = item_of(files)
    del item["assets"]["visual"]
    for asset in item["assets"].values():
        for band in asset["eo:bands"]:
            band.pop("name", None)
            if not centre:
                band.pop("center_wavelength", None)
    (tmp_path / "item.json").write_text(json.dumps(item))
    (listed,) = list_scenes([str(tmp_path / "item.json")])
    assert listed.paths == tuple(files)


def test_bands_that_share_a_common_name_are_all_opened(files, tmp_path):
    item = item_of(files)
    for key, asset in item["assets"].items():
        if key != "visual":
            asset["eo:bands"] = [{"common_name": "rededge" if key[:2] in ("b3", "b4") else "nir"}]
    (tmp_path / "item.json").write_text(json.dumps(item))
    (listed,) = list_scenes([str(tmp_path / "item.json")])
    assert sorted(listed.paths) == sorted(files)


def test_an_item_of_odd_values_is_read_without_them(files, tmp_path):
    item = item_of(files)
    del item["assets"]["visual"]
    for asset in item["assets"].values():
        asset["roles"], asset["raster:bands"][0]["nodata"] = 5, 10**400
    (tmp_path / "item.json").write_text(json.dumps(item))
    assert open_scene(tmp_path / "item.json").source.info.nodatas == (None,) * 4


def test_neither_an_item_nor_its_bands_are_written_over(deglint, files, tmp_path):
    item = tmp_path / "item.json"
    item.write_text(json.dumps(item_of(files)))
    for target in (*files, tmp_path / "item.tif"):
        (tmp_path / "item.tif.json").unlink(missing_ok=True)
        Path(target).exists() or (tmp_path / "item.tif.json").symlink_to(item)
        before = [Path(f).read_bytes() for f in (*files, item)]
        ran = deglint("remove", item, target, "--overwrite", *RUN)
        assert ran.code == 1, ran.err
        assert [Path(f).read_bytes() for f in (*files, item)] == before


def test_an_offset_that_was_applied_is_not_applied_again(files, tmp_path):
    (tmp_path / "item.json").write_text(json.dumps(item_of(files, **{"earthsearch:boa_offset_applied": True})))
    assert open_scene(tmp_path / "item.json").source.info.offsets == (0,) * 4


@pytest.mark.slow
def test_items_of_a_collection_are_scenes_of_a_batch(deglint, files, tmp_path):
    items = [item_of(files) | {"id": name} for name in ("one", "two")]
    collection = tmp_path / "items.json"
    collection.write_text(json.dumps({"type": "FeatureCollection", "features": items}))
    with pytest.raises(InputError, match=r"2 STAC Items.*Name one.*items\.json#ID.*one, two"):
        open_scene(collection)
    assert open_scene(f"{collection}#two").names == ("B2", "B3", "B4", "B8")
    assert open_scene(f"{collection}#two#b8,b2").names == ("B8", "B2")
    assert [s.paths for s in list_scenes([str(collection)])] == [tuple(files)] * 2
    (tmp_path / "r.toml").write_text(
        f'[recipe]\nmethod = "hedley"\nsample = "all"\nmask = "none"\n[output]\ndirectory = "{tmp_path}/out"\n'
    )
    ran = deglint("batch", tmp_path / "r.toml", collection, "-q")
    assert ran.code == 0, ran.err + ran.out
    assert said_of(tmp_path / "out" / "one_deglinted.tif")[0] == ("B2", "B3", "B4", "B8")
    assert "finished before" in deglint("batch", tmp_path / "r.toml", collection, "-q").out


@beside()
def test_shared_files_of_one_band(deglint, tmp_path):
    files = [SHARED / "real" / "cartagena" / f"{code}.tiff" for code in (*SENTINEL2, "B11")]
    scene = open_scene(files)
    assert scene.names == (*SENTINEL2, "B11")
    assert [b.wavelength for b in scene.bands] == [492.4, 559.8, 664.6, 832.8, 1613.7]
    out = tmp_path / "out.tif"
    assert deglint("remove", *files, out, *RUN, "--compensate", "off").code == 0
    assert said_of(out)[0] == (*SENTINEL2, "B11")
    assert find_nir(open_scene(out)) == (3,)
