"""Pixels: any type, nodata, masks, scale, threads, broken files."""

import pickle
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import rasterio
from rasterio.enums import ColorInterp

from deglint.errors import InputError, ReadError
from deglint.raster.convert import is_valid, to_physical
from deglint.raster.environment import CACHE
from deglint.raster.source import ArraySource
from deglint.readers import open_scene

from .common import says, write_vrt
from .common import write_bare as write

SHAPE = (3, 20, 30)
WHOLE = ((0, 20), (0, 30))


def numbers(dtype, shape=SHAPE):
    return (np.arange(np.prod(shape)) % 120).reshape(shape).astype(dtype)


SINGLE = ["int8", "uint8", "int16", "uint16", "float32"]
DOUBLE = ["int32", "uint32", "int64", "uint64", "float64"]


@pytest.mark.parametrize("dtype", SINGLE + DOUBLE)
def test_every_type_is_read_as_it_is(tmp_path, dtype):
    array = numbers(dtype)
    source = open_scene(write(tmp_path / "a.tif", array)).source
    raw, valid = source.read_raw(WHOLE)
    assert raw.dtype == dtype
    assert valid is None
    np.testing.assert_array_equal(raw, array)
    physical = source.read(WHOLE, [2, 0])
    assert physical.dtype == (np.float32 if dtype in SINGLE else np.float64)
    np.testing.assert_array_equal(physical, array[[2, 0]])


def test_every_thread_reads_with_the_settings_of_gdal(tmp_path, monkeypatch):
    source, cache = open_scene(write(tmp_path / "a.tif", numbers("uint8"))).source, []
    monkeypatch.setattr(source, "_stacked", lambda *_: cache.append(rasterio.env.getenv()["GDAL_CACHEMAX"]))
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(source.read_raw, [WHOLE] * 4))
    assert cache == [CACHE] * 4


def test_float16_where_gdal_has_it(tmp_path):
    try:
        path = write(tmp_path / "a.tif", numbers("float16"))
    except TypeError:
        pytest.skip("this rasterio has no float16")
    assert open_scene(path).read().dtype == np.float32


def test_complex_is_refused_in_one_line(tmp_path):
    path = write(tmp_path / "a.tif", numbers("complex64"))
    with pytest.raises(InputError, match=r"band 1.*complex64.*integers and real") as caught:
        open_scene(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("dtype", ["uint8", "int16", "uint16", "int32", "float32", "float64"])
def test_nodata_becomes_nan_before_scale_and_offset(tmp_path, dtype):
    array = numbers(dtype)
    path = write(tmp_path / "a.tif", array, nodata=7, known={"scales": [0.5, 1, 2], "offsets": [0, -1, 3]})
    source = open_scene(path).source
    expected = array * np.array([0.5, 1, 2]).reshape(3, 1, 1) + np.array([0, -1, 3]).reshape(3, 1, 1)
    expected[array == 7] = np.nan
    np.testing.assert_allclose(source.read(WHOLE, [0, 1, 2]), expected, rtol=1e-6)
    raw, valid = source.read_raw(WHOLE)
    np.testing.assert_array_equal(valid, array != 7)
    np.testing.assert_array_equal(source.to_physical(raw, valid), source.read(WHOLE, [0, 1, 2]))
    np.testing.assert_array_equal(raw, array)


def test_nodata_of_the_caller_wins(tmp_path):
    path = write(tmp_path / "a.tif", numbers("uint16"), nodata=7)
    scene = open_scene(path, nodata=9)
    np.testing.assert_array_equal(np.isnan(scene.read()), numbers("uint16") == 9)
    assert scene.source.info.nodata == 9
    with pytest.raises(InputError, match=r"^nodata: .*0 to 65535.*uint16.*-9999"):
        open_scene(path, nodata=-9999)


def test_nodata_that_the_type_cannot_hold_is_ignored(tmp_path):
    write(tmp_path / "a.tif", numbers("uint8", (1, 20, 30)))
    more = "<NoDataValue>0.5</NoDataValue>"
    vrt = write_vrt(tmp_path / "a.vrt", 20, 30, "a.tif", bands=(1,), dtype="Byte", more=more)
    scene = open_scene(vrt)
    (note,) = scene.notes
    assert says(note, f"{vrt}: nodata 0.5 of band 1", "ignored", "uint8")
    assert np.isfinite(scene.read()).all()


@pytest.mark.parametrize("nodata", [np.nan, None])
def test_nan_and_infinity_are_not_valid(tmp_path, nodata):
    array = numbers("float32")
    array[0, 3, 4], array[1, 0, 0], array[2, 19, 29] = np.nan, np.inf, -np.inf
    source = open_scene(write(tmp_path / "a.tif", array, nodata=nodata)).source
    expected = np.where(np.isfinite(array), array, np.nan)
    np.testing.assert_array_equal(source.read(WHOLE, [0, 1, 2]), expected)
    raw, valid = source.read_raw(WHOLE)
    assert valid is None
    np.testing.assert_array_equal(source.to_physical(raw), expected)
    np.testing.assert_array_equal(raw, array)


def test_mask_file_and_alpha_are_honoured(tmp_path):
    array = numbers("uint16", (4, 20, 30))
    mask = np.full((20, 30), 255, np.uint8)
    mask[5:9, 2:4] = 0
    masked = open_scene(write(tmp_path / "masked.tif", array, mask=mask))
    assert len(masked.bands) == 4
    assert masked.source.info.mask_flags[0] == ("per_dataset",)
    np.testing.assert_array_equal(np.isnan(masked.read()), np.broadcast_to(mask == 0, array.shape))

    array = array.astype("uint8")
    array[3] = mask
    colours = [ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha]
    alpha = open_scene(write(tmp_path / "alpha.tif", array, known={"colorinterp": colours}, photometric="rgb"))
    assert alpha.names == ("red", "green", "blue")
    assert alpha.source.info.alpha == 4
    np.testing.assert_array_equal(np.isnan(alpha.read()), np.broadcast_to(mask == 0, (3, 20, 30)))
    raw, valid = alpha.source.read_raw(WHOLE)
    np.testing.assert_array_equal(valid, np.broadcast_to(mask != 0, raw.shape))


def test_fourth_byte_band_that_gdal_calls_alpha_can_be_near_infrared(tmp_path):
    array = numbers("uint8", (4, 20, 30))
    path = write(tmp_path / "a.tif", array)
    plain = open_scene(path)
    assert len(plain.bands) == 3
    assert "band 4 is used as alpha" in plain.notes[0]
    for scene in (open_scene(path, nir=4), open_scene(path, sensor="planetscope4")):
        assert len(scene.bands) == 4
        assert scene.source.info.colorinterp[3] == "undefined"
        np.testing.assert_array_equal(scene.read(), array)
    with rasterio.open(path, "r+") as dataset:
        dataset.set_band_description(4, "nir")
    assert open_scene(path).names[3] == "nir"


def test_the_number_of_the_near_infrared_is_that_of_the_stack(tmp_path):
    array = numbers("uint8", (4, 20, 30))
    array[3, :5] = 0
    colours = write(tmp_path / "a.tif", array)
    scene = open_scene([colours, write(tmp_path / "nir.tif", array[:1])], nir=4)
    assert scene.names == ("red", "green", "blue", "nir")
    assert np.isnan(scene.read()[:3, :5]).all()
    assert any("NIR is band 4 nir" in note for note in scene.notes)


def test_windows_tile_the_whole(tmp_path):
    array = numbers("uint16", (2, 70, 50))
    options = {"tiled": True, "blockxsize": 16, "blockysize": 16, "compress": "deflate"}
    scene = open_scene(write(tmp_path / "a.tif", array, nodata=3, **options))
    whole = scene.read()
    for top in range(0, 70, 33):
        for left in range(0, 50, 17):
            window = ((top, min(top + 33, 70)), (left, min(left + 17, 50)))
            part = whole[:, window[0][0] : window[0][1], window[1][0] : window[1][1]]
            np.testing.assert_array_equal(scene.read(window), part)


def test_a_window_may_be_lists(tmp_path):
    array = numbers("uint8")
    read = open_scene(write(tmp_path / "a.tif", array)).read([[2, 7], [3, 9]])
    np.testing.assert_array_equal(read, array[:, 2:7, 3:9])


def test_window_outside_is_refused_and_empty_is_empty(tmp_path):
    source = open_scene(write(tmp_path / "a.tif", numbers("uint8"))).source
    with pytest.raises(InputError, match=r"rows 0-20.*columns 0-30.*rows 0-21"):
        source.read(((0, 21), (0, 30)), [0])
    assert source.read(((4, 4), (0, 30)), [0]).shape == (1, 0, 30)


@pytest.mark.parametrize("band", [-1, 3, 5])
def test_a_band_outside_is_refused(tmp_path, band):
    array = numbers("uint8")
    source = open_scene(write(tmp_path / "a.tif", array)).source
    for one in (source, ArraySource(array, source.info)):
        with pytest.raises(InputError, match=rf"^bands: .*0-2.*from 0.* {band}$"):
            one.read(WHOLE, [0, band])


def test_many_threads_read_the_same(tmp_path):
    array = numbers("uint16", (2, 256, 256))
    scene = open_scene(write(tmp_path / "a.tif", array, tiled=True, blockxsize=64, blockysize=64, compress="lzw"))
    windows = [((r, r + 64), (c, c + 64)) for r in range(0, 256, 64) for c in range(0, 256, 64)] * 8
    start = threading.Barrier(4)

    def work(k):
        start.wait()
        return [scene.source.read(w, [0, 1]) for w in windows[k::4]]

    with ThreadPoolExecutor(4) as pool:
        for k, parts in enumerate(pool.map(work, range(4))):
            for ((top, bottom), (left, right)), part in zip(windows[k::4], parts, strict=True):
                np.testing.assert_array_equal(part, array[:, top:bottom, left:right])
    assert 1 <= len(scene.source._idle) <= 4
    scene.source.close()  # handles opened by other threads close here too


def test_close_and_pickle(tmp_path):
    array = numbers("uint8")
    with open_scene(write(tmp_path / "a.tif", array)).source as source:
        source.read(WHOLE, [0])
        copy = pickle.loads(pickle.dumps(source))
        (handle,) = source._idle
    assert handle[0].closed
    with pytest.raises(ReadError, match=r"was closed.*Open.*again"):
        source.read(WHOLE, [0])
    np.testing.assert_array_equal(copy.read(WHOLE, [0]), array[:1])


def test_a_read_that_ends_after_close_leaves_no_file_open(tmp_path):
    source = open_scene(write(tmp_path / "a.tif", numbers("uint8"))).source
    with source._datasets() as handles:
        source.close()
    assert handles[0].closed


def test_truncated_file_opens_and_then_says_where_it_breaks(tmp_path):
    path = tmp_path / "a.tif"
    rng = np.random.default_rng(1)
    write(path, rng.integers(1, 60000, (1, 400, 300), "uint16"), driver="COG", blocksize=128)
    path.write_bytes(path.read_bytes()[:-60000])
    scene = open_scene(path)
    assert scene.read(((0, 10), (0, 100))).shape == (1, 10, 100)
    says = r"cannot read rows 390-400, columns 0-300 of .*a\.tif: .*damaged: copy"
    with pytest.raises(ReadError, match=says) as caught:
        scene.read(((390, 400), (0, 300)))
    assert "\n" not in str(caught.value)
    assert scene.read(((0, 10), (0, 100))).shape == (1, 10, 100)


def test_file_cut_in_its_header_is_refused(tmp_path):
    path = tmp_path / "a.tif"
    write(path, numbers("uint16", (1, 400, 300)), tags={"a": "1"})  # which move the header behind the pixels
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(ReadError, match=r"cannot open .*a\.tif.*truncated or damaged"):
        open_scene(path)


def test_giant_header_costs_nothing_to_open(tmp_path):
    path = tmp_path / "giant.tif"
    size = 1_000_000
    options = {"sparse_ok": True, "bigtiff": "yes", "tiled": True, "blockxsize": 16384, "blockysize": 16384}
    with rasterio.open(path, "w", driver="GTiff", dtype="uint8", count=1, height=size, width=size, **options):
        pass
    scene = open_scene(path)
    assert scene.shape == (1, size, size)


def test_pure_conversion_leaves_its_input_alone():
    raw = numbers("float32")
    raw.flags.writeable = False
    valid = raw != 5
    out = to_physical(raw, valid, [2.0] * 3, [1.0] * 3)
    np.testing.assert_array_equal(out, np.where(valid, raw * 2 + 1, np.nan))
    np.testing.assert_array_equal(to_physical(raw, valid, [1.0] * 3, [0.0] * 3), np.where(valid, raw, np.nan))


def test_half_precision_is_converted_without_a_warning(recwarn):
    raw = np.float16([[[1.5, np.inf, 6e4]]])
    np.testing.assert_array_equal(to_physical(raw, None, [1.0], [0.0]), np.where(np.isinf(raw), np.nan, raw))
    assert not recwarn.list


def test_valid_is_none_where_nothing_is_missing():
    raw = numbers("int16")
    assert is_valid(raw, [None, np.nan, -9999]) is None
    assert is_valid(raw, [1e9, 0.5, 300]) is None
    np.testing.assert_array_equal(is_valid(raw, [4, None, None])[0], raw[0] != 4)
    assert is_valid(np.float32([[[-3.4028235e38]]]), [-3.40282346638529e38]) is not None


@pytest.mark.parametrize("dtype", ["uint16", "float32", "float64"])
@pytest.mark.parametrize("shape", [(2, 5, 0), (2, 0, 5), (2, 0, 0)])
def test_no_pixels_are_no_trouble(dtype, shape):
    nothing = np.empty(shape, dtype)
    for scale in (1.0, 0.5):
        assert to_physical(nothing, None, [scale] * 2, [0.0] * 2).shape == shape
