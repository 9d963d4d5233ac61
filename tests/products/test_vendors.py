"""WorldView, GeoEye, Pleiades and SPOT, and the captures and mosaics of drones: as `test_products`."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import rasterio
from PIL import Image

import deglint
from deglint import Recipe, remove_glint
from deglint.errors import InputError, ReadError
from deglint.pipeline.messages import log_scene
from deglint.readers.products.drone import _black_level

from ..common import SHARED, beside

WV = {"COASTAL": 425, "BLUE": 480, "GREEN": 545, "YELLOW": 605, "RED": 660, "REDEDGE": 725, "NIR1": 832.5, "NIR2": 950}
RADIANCE = {"unit": "W m-2 sr-1 um-1", "nodata": 0, "offset": 0, "full": 65535}
DG = RADIANCE | {"bands": WV, "scale": 9e-3 / 4e-2, "sensor": "worldview2", "first": 0.225 * 901}
PHR = RADIANCE | {"bands": {"B2": 650, "B1": 560, "B0": 490, "B3": 840}, "scale": 1 / 11, "offset": 0.5, "full": 4095,
                  "sensor": "pleiades", "first": 403 / 11 + 0.5}  # fmt: skip
R = np.hypot(70 - 45, 40 - 38)  # of the pixel that is looked at, from the centre of the vignette
MICASENSE = {"Blue": 475, "Green": 560, "Red": 668, "NIR": 842, "Red edge": 717}
CAPTURE = {"bands": MICASENSE, "scale": 1e-4 / (2 * 0.002 * 65536), "offset": -4800e-4 / (2 * 0.002 * 65536),
           "unit": "W m-2 sr-1 nm-1", "sensor": "micasense", "nodata": None, "full": None,
           "first": 901e-4 / (2 * 0.002 * 65536) / (1 + 1e-4 * R - 5e-5 * R**2) / (1 + 3e-5 * 40)}  # fmt: skip
DJI = {"bands": {"Green": 560, "Red": 650, "RedEdge": 730, "NIR": 860}, "scale": 0.5 / (65536 * 2e-3),
       "offset": -1600 / (65536 * 2e-3), "unit": None, "sensor": None, "nodata": None, "full": None,
       "first": 705 * 0.5 / (65536 * 2e-3) * (1 + 1e-4 * R + 2e-5 * R**2)}  # fmt: skip


def volume(folder):
    """The file that names the parts of a Pleiades product."""
    path = folder / "VOL_PHR.XML"
    path.write_text("<Dimap_Document><Dataset_Content/></Dimap_Document>")
    return path


CASES = {
    "WV-2": (lambda v, f, s: v.maxar(f, s), "WorldView-2 LV2A", DG),
    "WV-2 mosaic": (lambda v, f, s: next(v.maxar(f, s, tiles=2).rglob("*M2AS*.TIL")), "WorldView-2 LV2A", DG),
    "WV-2 IMD": (lambda v, f, s: next(v.maxar(f, s).rglob("*M2AS*.IMD")), "WorldView-2 LV2A", DG),
    "WV-2 image": (lambda v, f, s: next(v.maxar(f, s).rglob("*M2AS*.TIF")), "WorldView-2 LV2A", DG),
    "GeoEye-1": (
        lambda v, f, s: v.maxar(f, s, satellite="GE01", letters=("B", "G", "R", "N")),
        "GeoEye-1 LV2A",
        DG | {"bands": {"BLUE": 480, "GREEN": 545, "RED": 672.5, "NIR": 850}, "sensor": "geoeye1"},
    ),
    "Pleiades": (lambda v, f, s: v.dimap(f, s), "Pleiades 1A", PHR),
    "Pleiades VOL": (lambda v, f, s: volume(v.dimap(f, s)), "Pleiades 1A", PHR),
    "Pleiades DIM": (lambda v, f, s: next(v.dimap(f, s, tiles=1).rglob("DIM*_MS_*.XML")), "Pleiades 1A", PHR),
    "SPOT": (lambda v, f, s: v.dimap(f, s, mission="SPOT", listed=False), "SPOT 1A", PHR | {"sensor": None}),
    "MicaSense": (lambda v, f, s: v.micasense(f, s), "MicaSense RedEdge-M", CAPTURE),
    "MicaSense Altum": (
        lambda v, f, s: v.micasense(f, s, more=(("LWIR", 11000, 6000),)), "MicaSense RedEdge-M", CAPTURE,
    ),
    "DJI": (lambda v, f, s: v.dji(f, s), "DJI M3M", DJI),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_product_says_all_of_itself(make, vendor, sea, tmp_path, case):
    maker, kind, facts = CASES[case]
    array = sea()
    array[:, 40, 70] = np.array([901, 705, 403, 101])
    path = maker(vendor, tmp_path, array)
    scene = deglint.open_scene(path)
    make.check(scene, kind, facts)
    assert scene.path == str(path)
    assert scene.read(((40, 41), (70, 71)), [0])[0, 0, 0] == pytest.approx(facts["first"], rel=1e-4)
    captured = case in ("MicaSense", "MicaSense Altum", "DJI")
    assert any("registered to each other" in n for n in scene.notes) == captured
    assert any("vignette" in n and "corrected as the XMP says" in n for n in scene.notes) == captured
    assert any("LWIR left out" in n for n in scene.notes) == (case == "MicaSense Altum")
    assert any("B2, B1, B0, B3 is assumed" in n for n in scene.notes) == (case == "SPOT")
    if "WV" in case:
        assert [b.group for b in scene.bands] == ["MS2", "MS1", "MS1", "MS2", "MS1", "MS2", "MS1", "MS2"]
        assert {b.time_offset for b in scene.bands} > {0.0, 0.324}


def test_the_xml_stands_in_for_the_imd(vendor, sea, tmp_path):
    imd = next(vendor.maxar(tmp_path, sea()).rglob("*M2AS*.IMD"))
    imd.unlink()
    imd.with_suffix(".XML").write_text(vendor.imd_xml())
    for path in (imd.parent, imd.with_suffix(".XML")):
        info = deglint.open_scene(path).source.info
        assert info.scales[:2] == pytest.approx((9e-3 / 4e-2, 9.1e-3 / 5e-2))
        assert (info.tags[""]["satellite"], info.tags[""]["sun_elevation"]) == ("WorldView-2", "61.5")


def test_dates_and_angles_become_tags(vendor, sea, tmp_path):
    tags = deglint.open_scene(vendor.maxar(tmp_path / "m", sea())).source.info.tags[""]
    assert (tags["acquired"], tags["sun_elevation"], tags["off_nadir_angle"]) == (
        "2017-07-05T21:16:35.787350Z",
        "61.5",
        "21.4",
    )
    tags = deglint.open_scene(vendor.dimap(tmp_path / "d", sea())).source.info.tags[""]
    assert (tags["acquired"], tags["sun_elevation"], tags["view_angle"]) == ("2022-01-15T10:30:45.6Z", "61.0", "12.5")


@pytest.mark.parametrize(("left", "said"), [("date", "2022-01-15 2022-03-11"), ("", "None None")])
def test_a_date_or_time_that_is_missing_is_left_out_of_the_tag(make, vendor, sea, tmp_path, left, said):
    found = []
    for folder in (vendor.dimap(tmp_path / "d", sea()), make.landsat(tmp_path / "l", sea())):
        for file in (*folder.rglob("*.XML"), *folder.rglob("*_MTL.txt")):
            text = re.sub(r"10:30:45.6Z|03:47:32.6439190Z", "", file.read_text())
            file.write_text(text if left else re.sub(r"2022-01-15(?=</IMAGING)|2022-03-11", "", text))
        found.append(str(deglint.open_scene(folder).source.info.tags[""].get("acquired")))
    assert " ".join(found) == said


def test_tiles_lie_where_they_belong(vendor, sea, tmp_path):
    array = sea()
    for i, folder in enumerate((vendor.maxar(tmp_path / "m", array, tiles=2), vendor.dimap(tmp_path / "d", array))):
        scene = deglint.open_scene(folder)
        assert scene.shape[1:] == (80, 100)
        band, info = scene.index(("BLUE", "B0")[i]), scene.source.info
        raw = (scene.read(None, [band])[0] - info.offsets[band]) / info.scales[band]
        np.testing.assert_allclose(raw, array[0], rtol=1e-4)


@pytest.mark.parametrize("processing", ["DISPLAY", "REFLECTANCE"])
def test_what_is_no_radiance_is_not_scaled(vendor, sea, tmp_path, processing):
    scene = deglint.open_scene(vendor.dimap(tmp_path / "d", sea(), processing=processing))
    assert set(scene.source.info.scales) == {1.0}
    assert sum("without scaling" in n for n in scene.notes) == 1
    scene = deglint.open_scene(vendor.maxar(tmp_path / "m", sea(), enhancement="DRA"))
    assert set(scene.source.info.scales) == {1.0}
    assert sum("is enhanced (DRA)" in n for n in scene.notes) == 1


@pytest.mark.parametrize("name", ["../other.TIF", "/etc/passwd", "/vsicurl/http://x/a.tif", "missing.TIF"])
def test_names_in_metadata_do_not_leave_the_folder(vendor, sea, tmp_path, name):
    vendor.raster(tmp_path / "other.TIF", *sea())
    dim = next(vendor.dimap(tmp_path / "d", sea(), tiles=1).rglob("DIM*_MS_*.XML"))
    dim.write_text(vendor.dimap_metadata([name], 80, 100))
    with pytest.raises(InputError, match="not in its folder") as caught:
        deglint.open_scene(dim)
    assert "\n" not in str(caught.value)
    til = next(vendor.maxar(tmp_path / "m", sea()).rglob("*M2AS*.TIL"))
    til.write_text(vendor.til([(name, (0, 50), (0, 80)), ("17JUL.TIF", (50, 100), (0, 80))], 100, 80))
    with pytest.raises(InputError, match=r"some tiles.*not in its folder"):
        deglint.open_scene(til)


@pytest.mark.parametrize("broken", ["<a", "\0"], ids=["cut off", "zero"])
def test_damaged_metadata_say_what_to_do(vendor, sea, tmp_path, broken):
    dim = next(vendor.dimap(tmp_path / "d", sea(), tiles=1).rglob("DIM*_MS_*.XML"))
    dim.write_text(broken)
    with pytest.raises(InputError, match=r"Download.*image itself"):
        deglint.open_scene(dim)
    image = next((tmp_path / "d").rglob("IMG*_MS_*.TIF"))
    imd = next(vendor.maxar(tmp_path / "m", sea()).rglob("*M2AS*.IMD"))
    imd.write_text(broken)
    with pytest.raises(InputError, match=r"damaged.*image itself"):
        deglint.open_scene(imd)
    for path, count in ((image, 4), (imd.with_suffix(".TIF"), 8)):
        scene = deglint.open_scene(path)
        assert len(scene.bands) == count


def test_several_captures_say_what_to_name(vendor, sea, tmp_path, caplog):
    vendor.micasense(tmp_path, sea())
    for path in sorted(tmp_path.glob("IMG_0192_*.tif")):
        path.with_name(path.name.replace("0192", "0193")).write_bytes(path.read_bytes())
    with pytest.raises(InputError, match=r"2 captures.*IMG_0192, IMG_0193.*Name.*IMG_0192_1"):
        deglint.open_scene(tmp_path)
    scene = deglint.open_scene(sorted(tmp_path.glob("IMG_0192_*.tif")))
    assert [b.wavelength for b in scene.bands] == list(MICASENSE.values())
    assert any("registered to each other" in n for n in scene.notes)
    with caplog.at_level("INFO", "deglint"):
        log_scene(scene)
    assert "registered to each other" in caplog.text
    alone = deglint.open_scene(tmp_path / "IMG_0192_4.tif")
    assert [(b.name, b.wavelength) for b in alone.bands] == [("NIR", 842)]
    assert not any("registered to each other" in n for n in alone.notes)


def test_a_capture_is_named_by_the_bands_that_it_keeps(vendor, sea, tmp_path):
    vendor.micasense(tmp_path, sea())
    vendor.raster(tmp_path / "IMG_0192_6.tif", sea()[3].astype("uint16"), placed=False)  # without XMP
    assert deglint.open_scene(tmp_path).product == "MicaSense RedEdge-M IMG_0192"


def test_a_mosaic_is_named_by_its_xmp_unless_the_file_names_its_bands(vendor, sea, tmp_path):
    path = vendor.mosaic(tmp_path, sea())
    scene = deglint.open_scene(path)
    assert {b.name: (b.wavelength, b.width) for b in scene.bands} == {n: (c, w) for n, c, w in vendor.MICASENSE}
    assert set(scene.source.info.scales) == {1.0}
    with rasterio.open(path, "r+") as dataset:
        dataset.descriptions = ("b1", "b2", "b3", "b4", "b5")
    scene = deglint.open_scene(path)
    assert (scene.names[0], scene.bands[0].wavelength) == ("b1", 475)


def test_vignette_and_rows_are_corrected_in_any_window(vendor, sea, tmp_path):
    array = sea()
    scene = deglint.open_scene(vendor.micasense(tmp_path, array))
    y, x = np.mgrid[:80, :100]
    r = np.hypot(x - 45, y - 38)
    wanted = array[1] * 1e-4 / (2 * 0.002 * 65536) / (1 + 1e-4 * r - 5e-5 * r**2) / (1 + (1e-7 / 0.002 - 2e-5) * y)
    for rows, columns in ((slice(0, 80), slice(0, 100)), (slice(13, 40), slice(60, 99))):
        window = ((rows.start, rows.stop), (columns.start, columns.stop))
        np.testing.assert_allclose(scene.read(window, ["Green"])[0], wanted[rows, columns], rtol=2e-4)
        raw, valid = scene.source.read_raw(window)
        np.testing.assert_allclose(scene.source.to_physical(raw, valid)[1], wanted[rows, columns], rtol=2e-4)
    alone = deglint.open_scene(tmp_path / "IMG_0192_2.tif")
    np.testing.assert_allclose(alone.read()[0], wanted, rtol=2e-4)


@pytest.mark.parametrize("kind", ["zip", "tar"])
def test_the_black_level_is_read_in_archives_too(tmp_path, monkeypatch, kind):
    monkeypatch.chdir(tmp_path)
    Path("all/IMG").mkdir(parents=True)
    Image.new("I;16", (4, 3)).save("all/IMG/IMG_0192_1.tif", tiffinfo={50714: 4900})
    shutil.make_archive("capture", kind, "all")
    for path in ("all", f"/vsi{kind}/capture.{kind}", f"/vsi{kind}/{tmp_path}/capture.{kind}"):
        assert _black_level(f"{path}/IMG/IMG_0192_1.tif") == 4900


def test_bands_that_are_not_registered_are_a_warning(vendor, sea, tmp_path, caplog):
    source, recipe = vendor.micasense(tmp_path, sea()), Recipe(method="hedley", sample="all", mask="none")
    (warning,) = [w for w in remove_glint(source, tmp_path / "out.tif", recipe).warnings if "registered" in w]
    assert warning.startswith("the bands are assumed not to be registered to each other")
    assert warning in [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]


def test_what_is_no_capture_is_not_corrected(vendor, sea, tmp_path):
    """Programs copy the XMP to what they make of a capture; only the camera's own names are captures."""
    path = next(vendor.micasense(tmp_path, sea()).glob("IMG_0192_2.tif"))
    copy = deglint.open_scene(path.rename(tmp_path / "reflectance_green.tif"))
    assert (copy.bands[0].name, copy.bands[0].wavelength, copy.source.info.scales) == ("Green", 560, (1.0,))


def test_a_damaged_xmp_is_not_used(vendor, sea, tmp_path):
    path = vendor.raster(tmp_path / "a.tif", *sea(), describe=vendor.tagged("<a=<"))
    scene = deglint.open_scene(path)
    assert len(scene.bands) == 4


@pytest.mark.parametrize("case", ["WV-2 mosaic", "Pleiades", "MicaSense"])
def test_remove_writes_the_products_own_numbers(deglint, vendor, sea, tmp_path, case):
    path = CASES[case][0](vendor, tmp_path, sea())
    out = tmp_path / "out.tif"
    ran = deglint("remove", path, out, "--mask", "none", "--sample", "all", "--method", "hedley")
    assert ran.code == 0, ran.err
    from deglint import open_scene

    before, after = open_scene(path), open_scene(out)
    assert [(b.name, b.wavelength, b.group) for b in after.bands] == [
        (b.name, b.wavelength, b.group) for b in before.bands
    ]
    with rasterio.open(out) as dataset:
        assert set(dataset.dtypes) == {"float32" if case == "MicaSense" else "uint16"}
        assert dataset.scales == pytest.approx(before.source.info.scales)


@beside("real", "micasense")
def test_real_captures():
    scene = deglint.open_scene(SHARED / "real" / "micasense")
    assert {b.name: b.wavelength for b in scene.bands} == MICASENSE
    assert scene.sensor == "micasense"
    info = scene.source.info
    assert info.flat is not None
    assert info.scales[0] == pytest.approx(9.169207e-05 / (65536 * 2.025e-4))
    assert info.offsets[0] == pytest.approx(-4800 * info.scales[0])
    assert np.nanmedian(scene.read(((400, 500), (600, 700)), [0])) == pytest.approx(0.05, abs=0.04)
    with pytest.raises(ReadError, match="no such file"):
        deglint.open_scene(SHARED / "real" / "micasense" / "IMG_0192_9.tif")


@beside("real", "micasense")
@pytest.mark.parametrize(("number", "top", "left"), [(1, 98, 442), (4, 116, 442)], ids=["blue", "nir"])
def test_a_real_capture_is_as_bright_as_other_software_makes_it(number, top, left):
    """The aligned stack beside it was calibrated by other software: the ratio of both is even over the image."""
    import cv2

    folder = SHARED / "real" / "micasense"
    with rasterio.open(folder / "aligned_0192.tif") as dataset:
        wanted = dataset.read(number).astype("float32")
    with rasterio.open(folder / f"IMG_0192_{number}.tif") as dataset:
        raw = dataset.read(1).astype("float32") - 4800
    ours = deglint.open_scene(folder / f"IMG_0192_{number}.tif").read()[0]
    rows, columns = wanted.shape
    uneven = [
        np.log(cv2.blur(a[top : top + rows, left : left + columns], (81, 81)) / cv2.blur(wanted, (81, 81))).std()
        for a in (ours, raw)
    ]
    assert uneven[0] < 0.015 < 0.05 < uneven[1]
