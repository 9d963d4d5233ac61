"""Products open by themselves: what is known of them comes from their own metadata; damaged ones say so."""

import json

import numpy as np
import pytest
import rasterio

import deglint
from deglint.errors import InputError, ReadError
from deglint.readers.products import find

from ..common import SHARED, beside, says

S2_BANDS = {"B02": 492.7, "B03": 559.8, "B04": 664.6, "B05": 704.1, "B08": 832.8, "B11": 1613.7}
OLI = (443, 482, 561, 654, 865, 1608, 2200)


def zipped(make, folder, sea):
    return make.packed(make.sentinel2(folder, sea), "zip", folder / "zip" / "download.zip")


def tarred(make, folder, sea):
    return make.packed(make.landsat(folder, sea), "tar", folder / "tar" / "download.tar")


def cut(make, folder, sea):
    """Band files beside the metadata, as distributors cut them."""
    for name, array in zip(("B02", "B03", "B04", "B08"), sea + 1000, strict=True):
        make.raster(folder / f"{name}.tif", array)
    (folder / "MTD_MSIL2A.xml").write_text(make.sentinel2_metadata("2A"))
    return folder


def s2(offset=-0.1, names=tuple(S2_BANDS)):
    return {"bands": {n: S2_BANDS[n] for n in names}, "scale": 1e-4, "offset": offset, "unit": "reflectance",
            "sensor": "sentinel2", "nodata": 0, "full": 65535, "first": 1e-4 * 901}  # fmt: skip


def oli(names, **facts):
    return {"bands": dict(zip(names, OLI, strict=False)), "unit": "reflectance", "sensor": "landsat8", "nodata": 0,
            "full": 65535} | facts  # fmt: skip


SR, TOA = tuple(f"SR_B{n}" for n in range(1, 8)), tuple(f"B{n}" for n in range(1, 8))
LEVEL2 = oli(SR, scale=2.75e-05, offset=-0.2, first=2.75e-05 * 8201 - 0.2)
PLANET8 = {"coastal_blue": 441.5, "blue": 490, "green_i": 531, "green": 565, "yellow": 610, "red": 665, "rededge": 705,
           "nir": 865}  # fmt: skip
PLANET = {"unit": "reflectance", "nodata": 0, "offset": 0, "full": 65535}
CASES = {
    "S2 L2A folder": (lambda m, f, s: m.sentinel2(f, s), "Sentinel-2 L2A", s2()),
    "S2 L1C folder": (lambda m, f, s: m.sentinel2(f, s, "1C"), "Sentinel-2 L1C", s2()),
    "S2 zip": (zipped, "Sentinel-2 L2A", s2()),
    "S2 metadata": (lambda m, f, s: m.sentinel2(f, s) / "MTD_MSIL2A.xml", "Sentinel-2 L2A", s2()),
    "S2 old": (
        lambda m, f, s: m.sentinel2(f, s, "1C", metadata=m.sentinel2_metadata("1C", offset=None, baseline="02.09")),
        "Sentinel-2 L1C",
        s2(0.0) | {"first": 1e-4 * 1901},
    ),
    "S2 cut": (cut, "Sentinel-2 L2A", s2(names=("B02", "B03", "B04", "B08"))),
    "Landsat L2": (lambda m, f, s: m.landsat(f, s), "Landsat 9 Level 2", LEVEL2),
    "Landsat tar": (tarred, "Landsat 9 Level 2", LEVEL2),
    "Landsat json": (lambda m, f, s: next(m.landsat(f, s, form="json").glob("*.json")), "Landsat 9 Level 2", LEVEL2),
    "Landsat xml": (lambda m, f, s: next(m.landsat(f, s, form="xml").glob("*.xml")), "Landsat 9 Level 2", LEVEL2),
    "Landsat L1": (
        lambda m, f, s: m.landsat(f, s, 1),
        "Landsat 8 Level 1",
        oli(TOA, scale=2e-05, offset=-0.1, first=2e-05 * 8201 - 0.1) | {"more": {"B9": 1373.5}},
    ),
    "Planet 4": (
        lambda m, f, s: m.planetscope(f, s),
        "PlanetScope AnalyticMS, 4 bands",
        PLANET | {"bands": {"blue": 490.5, "green": 566, "red": 666, "nir": 867}, "scale": 2.1e-05,
                  "sensor": "planetscope4", "first": 2.1e-05 * 901},
    ),
    "Planet 4, SuperDove": (
        lambda m, f, s: m.planetscope(f, s, instrument="PSB.SD"),
        "PlanetScope AnalyticMS, 4 bands",
        PLANET | {"bands": {"blue": 490, "green": 565, "red": 665, "nir": 865}, "scale": 2.1e-05,
                  "sensor": "planetscope8", "first": 2.1e-05 * 901},
    ),
    "Planet 4, first Dove": (
        lambda m, f, s: m.planetscope(f, s, instrument="PS2"),
        "PlanetScope AnalyticMS, 4 bands",
        PLANET | {"bands": {"blue": 485, "green": 545, "red": 630, "nir": 820}, "scale": 2.1e-05, "sensor": None,
                  "first": 2.1e-05 * 901},
    ),
    "Planet 8 SR": (
        lambda m, f, s: next(m.planetscope(f, s, 8, surface=True).glob("*.xml")),
        "PlanetScope AnalyticMS_SR, 8 bands",
        PLANET | {"bands": PLANET8, "scale": 1e-4, "sensor": "planetscope8", "first": 1e-4 * 901},
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_product_says_all_of_itself(make, sea, tmp_path, case):
    maker, kind, facts = CASES[case]
    array = sea()
    array[:, 40, 50] = np.array([901, 705, 403, 101])
    path = maker(make, tmp_path, array)
    scene = deglint.open_scene(path)
    make.check(scene, kind, facts)
    assert scene.path == str(path)
    assert scene.product == f"{kind} {find(str(path)).name}"
    assert scene.read(((40, 41), (50, 51)), [0])[0, 0, 0] == pytest.approx(facts["first"], rel=1e-5)
    product = find(str(path))
    assert product.name in scene.notes[0]
    assert scene.source.info.tags[""]["product"] == product.name


def test_nodata_is_nan_and_coarse_bands_lie_on_the_grid_of_the_fine(make, sea, tmp_path):
    array = sea()
    array[0, :3] = 0
    folder = make.landsat(tmp_path, array)
    scene = deglint.open_scene(folder)
    assert np.isnan(scene.read(((0, 1), (0, 5)), ["SR_B5"])).all()
    assert np.isfinite(scene.read(((1, 2), (0, 5)), ["SR_B5"])).all()
    scene = deglint.open_scene(make.sentinel2(tmp_path, sea()))
    assert scene.shape == (6, 80, 100)
    assert any(says(n, "B05, B11", "bilinear", "grid of B02") for n in scene.notes)
    assert any(n.startswith("B01 (pixels of 60 m) left out") for n in scene.notes)
    assert any("no files of B06, B07, B8A, B12" in n for n in scene.notes)


def test_one_band_files_of_a_product_and_a_band_of_60_m_that_is_named(make, sea, tmp_path):
    safe = make.sentinel2(tmp_path, sea())
    files = {p.name.split("_")[2]: p for p in sorted(safe.rglob("R*/T*_B*.jp2"), reverse=True)}
    scene = deglint.open_scene([files["B02"], files["B08"], files["B01"]])
    assert [(b.name, b.wavelength) for b in scene.bands] == [("B02", 492.7), ("B08", 832.8), ("B01", 442.7)]
    assert set(scene.source.info.offsets) == {-0.1}
    assert scene.notes[0].endswith(": B02, B08, B01")
    assert scene.footprints is not None
    granule = next((safe / "GRANULE").iterdir())
    assert deglint.open_scene(granule).names == deglint.open_scene(granule / "IMG_DATA").names == tuple(S2_BANDS)


def test_detector_footprints_lie_on_the_grid_of_the_scene(make, sea, tmp_path):
    scene = deglint.open_scene(make.sentinel2(tmp_path, sea()))
    bands = [scene.index("B02"), scene.index("B11")]
    found = scene.footprints.read(((0, 40), (48, 52)), bands)
    assert (found.dtype, found.shape) == (np.dtype("float32"), (2, 40, 4))
    np.testing.assert_array_equal(found[:, 3:], np.broadcast_to([5, 5, 6, 6], (2, 37, 4)))
    assert np.isnan(found[:, 0]).all()
    assert {b.name: b.time_offset for b in scene.bands if b.name in ("B02", "B04")} == {"B02": 0.0, "B04": 1.005}
    assert any("reverse order" in n for n in scene.notes)
    import pickle

    copy = pickle.loads(pickle.dumps(scene))
    np.testing.assert_array_equal(copy.footprints.read(((0, 40), (48, 52)), bands), found)
    scene.footprints.close()


def test_products_without_masks_have_no_footprints(make, sea, tmp_path):
    assert deglint.open_scene(make.sentinel2(tmp_path, sea(), masks="")).footprints is None
    assert deglint.open_scene(make.landsat(tmp_path, sea())).footprints is None


def test_sentinel2_without_metadata_opens_as_it_stands(make, sea, tmp_path):
    scene = deglint.open_scene(make.sentinel2(tmp_path, sea(), metadata=""))
    assert scene.names == tuple(S2_BANDS)
    assert set(scene.source.info.scales) == {1.0}
    said = [n for n in scene.notes if "scale and offset are not" in n]
    assert len(said) == 1
    assert "--scale" in said[0]


@pytest.mark.parametrize("broken", ["<a", "<a/>"], ids=["cut off", "another"])
def test_damaged_metadata_are_named_and_an_image_opens_without_them(make, sea, tmp_path, broken):
    safe = make.sentinel2(tmp_path / "s", sea(), metadata=broken)
    landsat = make.landsat(tmp_path / "l", sea(), 1)
    next(landsat.glob("*MTL*")).write_text(broken)
    for folder, image in ((safe, "*B02_10m.jp2"), (landsat, "*_B2.TIF")):
        with pytest.raises(InputError, match=r"damaged.*Download.*image itself\.$"):
            deglint.open_scene(folder)
        assert len(deglint.open_scene(next(folder.rglob(image))).bands) == 1


def test_landsat_and_planetscope_open_without_metadata(make, sea, tmp_path):
    folder = make.landsat(tmp_path / "l", sea(), 1)
    next(folder.glob("*MTL*")).unlink()
    planet = make.planetscope(tmp_path / "p", sea(), metadata=False)
    for path, count, scale, said in ((folder, 8, 2e-5, "are assumed"), (planet, 4, 1.0, "without scaling")):
        scene = deglint.open_scene(path)
        assert (len(scene.bands), set(scene.source.info.scales)) == (count, {scale})
        assert sum(said in n for n in scene.notes) == 1
        assert all(b.wavelength for b in scene.bands)


def test_landsat_level_2_is_scaled_without_metadata_and_scenes_lie_side_by_side(make, sea, tmp_path):
    folder = make.landsat(tmp_path, sea())
    mtl = next(folder.glob("*MTL*"))
    for path in sorted(folder.iterdir()):
        path.with_name(path.name.replace("20220311", "20220412")).write_bytes(path.read_bytes())
    with pytest.raises(InputError, match=r"2 Landsat scenes.*Name.*_MTL\.txt"):
        deglint.open_scene(folder)
    for path, names in ((mtl, SR), ([folder / f"{make.L2}_SR_B5.TIF", folder / f"{make.L2}_SR_B3.TIF"], SR[4:1:-2])):
        scene = deglint.open_scene(path)
        assert scene.names == names
        assert scene.notes[0].startswith(f"Landsat 9 Level 2, product {make.L2}: ")
    for path in [mtl, *folder.glob("*20220412*")]:
        path.unlink()
    for given in (folder, sorted(folder.glob("*.TIF"))):
        scene = deglint.open_scene(given)
        assert (scene.source.info.scales[0], scene.source.info.offsets[0]) == (2.75e-05, -0.2)
        assert sum("are assumed" in n for n in scene.notes) == 1


def test_several_products_or_none_say_what_to_name(make, sea, tmp_path):
    make.sentinel2(tmp_path / "a", sea())
    make.sentinel2(tmp_path / "a", sea(), "1C")
    with pytest.raises(InputError, match=r"2 Sentinel-2 products.*MTD_MSIL1C\.xml.*Name one") as caught:
        deglint.open_scene(tmp_path / "a")
    assert "\n" not in str(caught.value)
    make.raster(tmp_path / "b" / "any.tif", *sea())
    with pytest.raises(ReadError, match=r"not a complete product.*Name the raster files"):
        deglint.open_scene(tmp_path / "b")
    (tmp_path / "c.zip").write_bytes(b"PK\3\4 and no more")
    with pytest.raises(ReadError, match=r"c\.zip.*download it again"):
        deglint.open_scene(tmp_path / "c.zip")
    (tmp_path / "d.tar.gz").write_bytes(b"\x1f\x8b and no more")
    with pytest.raises(ReadError, match="packed with gzip"):
        deglint.open_scene(tmp_path / "d.tar.gz")


def test_a_files_own_scale_counts_more_than_the_product_beside_it(make, sea, tmp_path):
    folder = cut(make, tmp_path, sea())
    with rasterio.open(folder / "B02.tif", "r+") as dataset:
        dataset.scales, dataset.offsets = (0.5,), (1.0,)
    make.raster(folder / "B03.tif", sea()[1].astype("float32"))
    scene = deglint.open_scene(folder)
    assert scene.source.info.scales == (0.5, 1.0, 1e-4, 1e-4)
    assert sum("its own scale and offset" in n for n in scene.notes) == 1
    assert sum("floating-point numbers are taken as they are" in n for n in scene.notes) == 1


def test_a_band_of_a_product_that_its_file_calls_alpha_is_a_band_of_the_scene(make, sea, tmp_path):
    image = next(make.planetscope(tmp_path, sea()).glob("*_AnalyticMS.tif"))
    make.raster(image, *sea(), pixel=3, photometric="RGB", alpha="YES")
    assert deglint.open_scene(image).names == ("blue", "green", "red", "nir")
    make.raster(image, *sea()[:3], pixel=3)
    scene = deglint.open_scene(image)
    assert scene.names == ("band 1", "band 2", "band 3")
    assert sum(says(n, "3 bands", "metadata 4", "not used") for n in scene.notes) == 1


# ------------------------------------------------------------------------------------------------- commands


@pytest.mark.parametrize("case", ["S2 L2A folder", "S2 zip", "Landsat L2", "Planet 4"])
def test_remove_writes_the_products_own_numbers(deglint, make, sea, read, tmp_path, case):
    from deglint import open_scene

    path = CASES[case][0](make, tmp_path, sea())
    out = tmp_path / "out.tif"
    ran = deglint("remove", path, out, "--mask", "none", "--sample", "all", "--method", "hedley")
    assert ran.code == 0, ran.err
    before, after = open_scene(path), open_scene(out)
    assert find(str(path)).name in ran.err
    with rasterio.open(out) as dataset:
        assert dataset.dtypes[0] == "uint16"
        assert dataset.scales == pytest.approx(before.source.info.scales)
        assert dataset.offsets == pytest.approx(before.source.info.offsets)
        assert dataset.nodata == 0
    assert [(b.name, b.wavelength, b.time_offset) for b in after.bands] == [
        (b.name, b.wavelength, b.time_offset) for b in before.bands
    ]
    assert after.sensor == before.sensor
    blue = 1 if case == "Landsat L2" else 0
    a, b = (s.read(None, [blue]) for s in (before, after))
    assert np.nanstd(b) < 0.3 * np.nanstd(a)
    assert np.nanmean(b) == pytest.approx(np.nanmin(a), abs=0.02)
    said = json.loads((tmp_path / "out.tif.json").read_text())
    assert find(str(path)).name in said["notes"][0]
    assert said["product"].endswith(find(str(path)).name)
    assert {f["path"] for f in said["input"]} >= {band.path for band in find(str(path)).bands}


def test_info_and_score_open_products(deglint, make, sea, tmp_path, capfd):
    from detect.cli import run

    safe = make.sentinel2(tmp_path, sea())
    ran = deglint("info", make.packed(safe, "zip", tmp_path / "download.zip"))
    assert ran.code == 0
    assert f"Sentinel-2 L2A, product {make.S2.format('2A')}: B02, B03, B04, B05, B08, B11" in ran.out
    assert "B01 (pixels of 60 m) left out" in ran.out
    assert run(["score", str(safe), str(tmp_path / "s.tif"), "-b", "B02,B03,B04", "--mask", "none"]) == 0
    with rasterio.open(tmp_path / "s.tif") as dataset:
        assert dataset.shape == (80, 100)


@pytest.mark.slow
def test_batch_and_stac_lists_take_products(deglint, make, sea, tmp_path):
    from deglint.readers.scenes import list_scenes

    first = make.sentinel2(tmp_path / "a", sea())
    second = make.landsat(tmp_path / "b", sea(), form="json")
    item = {"type": "Feature", "id": "item", "assets": {"product": {"href": "a.zip", "type": "application/zip"}}}
    make.packed(make.sentinel2(tmp_path / "c", sea(), "1C"), "zip", tmp_path / "a.zip")
    (tmp_path / "item.json").write_text(json.dumps(item))
    (tmp_path / "r.toml").write_text(
        f'[recipe]\nmethod = "hedley"\nmask = "none"\nsample = "all"\n[output]\ndirectory = "{tmp_path / "out"}"\n'
    )
    given = [str(first / "MTD_MSIL2A.xml"), str(next(second.glob("*.json"))), str(tmp_path / "item.json")]
    assert [s.name for s in list_scenes(given)] == [make.S2.format("2A"), make.L2, "item"]
    ran = deglint("batch", tmp_path / "r.toml", *given)
    assert ran.code == 0, ran.err
    assert "3 done" in ran.out
    again = deglint("batch", tmp_path / "r.toml", *given)
    assert "3 finished before" in again.out


# ------------------------------------------------------------------------------------------------- real ones


@beside("real", "swell")
def test_a_cut_real_product_opens_with_what_is_there():
    safe = next((SHARED / "real" / "swell").glob("*.SAFE"))
    scene = deglint.open_scene(safe)
    assert [(b.name, b.wavelength, b.time_offset) for b in scene.bands] == [("B02", 492.7, 0.0), ("B04", 664.6, 1.005)]
    assert set(zip(scene.source.info.scales, scene.source.info.offsets, strict=True)) == {(1e-4, -0.1)}
    assert safe.stem in scene.notes[0]
    found = scene.footprints.read(((0, scene.height), (0, scene.width)), [0, 1])
    assert set(np.unique(found[np.isfinite(found)])) == {5.0, 6.0}
    assert (found[0] != found[1]).any()


@beside("real", "swell")
def test_sentinel2_offsets_are_those_that_viewing_angles_say():
    """Where a satellite that flies south-southwest stood when a detector saw the ground, in each band, tells when."""
    from deglint import sensors
    from deglint.readers.products.metadata import xml_of

    root = xml_of(next((SHARED / "real" / "swell").rglob("MTD_TL.xml")).read_bytes(), "MTD_TL.xml")
    heading, height, speed = np.radians(194.0), 786e3, 7.4e3
    along = {}
    for node in root.iter("Viewing_Incidence_Angles_Grids"):
        zenith, azimuth = (
            np.radians([[float(v) for v in row.text.split()] for row in node.find(kind).iter("VALUES")])
            for kind in ("Zenith", "Azimuth")
        )
        place = height * np.tan(zenith) * np.cos(azimuth - heading)
        along[int(node.get("detectorId")), int(node.get("bandId"))] = place
    table = [b.time_offset for b in sensors.load("sentinel2").bands]
    assert along
    for detector in {d for d, _ in along}:
        sign = 1 if detector % 2 else -1
        for band, offset in enumerate(table):
            seen = np.nanmean(along[detector, band] - along[detector, 1]) / speed
            assert sign * seen == pytest.approx(offset, abs=0.055)
