"""The numbers that come out: types, rounding, nodata, flags - against computations."""

import numpy as np
import pytest
import rasterio
from rasterio.enums import ColorInterp

import deglint as library
from deglint import Recipe, remove_glint
from deglint.errors import InputError
from deglint.pipeline import FLAGS
from deglint.raster.convert import encode, retype

from .common import DTYPES, PLAIN


def expected_of(raw, model, scale=1.0, offset=0.0):
    """Corrected file numbers before rounding, in float64, by the equation as it stands in the papers."""
    physical = raw.astype(np.float64) * scale + offset
    index = model.indexes[0]
    nir = sum(w * physical[b] for w, b in zip(index.weights, index.bands, strict=True))
    out = raw.astype(np.float64)
    for fit in model.fits:
        out[fit.band] = (physical[fit.band] - fit.slope * (nir - index.level) - offset) / scale
    return out


def sea_in(sea, dtype, **size):
    raw = sea(**size)
    return (raw // 24).clip(0, 255).astype(dtype) if dtype == "uint8" else raw.astype(dtype)


@pytest.mark.parametrize("dtype", DTYPES)
def test_every_type_comes_back_as_numpy_says(sea, write, read, tmp_path, dtype):
    raw = sea_in(sea, dtype)
    result = remove_glint(write(tmp_path / "in.tif", raw, photometric="minisblack"), tmp_path / "out.tif", PLAIN)
    out = read(tmp_path / "out.tif")
    assert out.dtype == dtype
    expected = expected_of(raw, result.fitted.model)
    np.testing.assert_array_equal(out[3], raw[3])
    if np.dtype(dtype).kind == "f":
        np.testing.assert_allclose(out, expected, rtol=3e-7 if dtype == "float32" else 1e-14)
        return
    limits = np.iinfo(dtype)
    rounded = np.rint(expected).clip(limits.min, limits.max)
    near_a_tie = np.abs(expected - np.floor(expected) - 0.5) < 0.01  # float32 may fall to the other side
    np.testing.assert_array_equal(out[~near_a_tie], rounded[~near_a_tie].astype(dtype))
    assert np.abs(out - rounded).max() <= 1
    for band, count in zip("0 1 2 3".split(), result.sidecar["pixels"]["clipped"].values(), strict=True):  # noqa: SIM905
        own = expected[int(band)]
        outside = (np.rint(own) < limits.min) | (np.rint(own) > limits.max)
        assert count == np.count_nonzero(outside & (int(band) < 3))


def test_rounding_is_to_nearest_with_ties_to_even():
    values = np.array([-0.5, 0.4, 0.5, 0.6, 1.5, 2.5, 254.5, 255.4, 255.6, 300.0])[None]
    raw = np.full(values.shape, 77, np.uint8)
    negative, clipped = encode(values, raw, scale=1.0, offset=0.0, where=np.ones(values.shape, bool))
    assert raw.ravel().tolist() == [0, 0, 0, 1, 2, 2, 254, 255, 255, 255]
    assert (clipped.sum(), negative.sum()) == (2, 1)


def test_what_float32_cannot_hold_is_not_written_as_infinity():
    values, raw = np.full((1, 2), 3e38, np.float32), np.full((1, 2), 7, np.float32)
    with np.errstate(over="ignore"):
        encode(values, raw, scale=0.01, offset=1.0, where=np.ones(values.shape, bool))
    assert (raw == 7).all()


@pytest.mark.parametrize("dtype", ["uint16", "int16", "float32", "float64"])
def test_scale_and_offset_are_used_and_kept(sea, write, tmp_path, dtype):
    raw = sea(dtype=dtype)

    def describe(dataset):
        dataset.scales, dataset.offsets = [2e-4] * 4, [-0.05] * 4
        dataset.units = ["reflectance"] * 4

    result = remove_glint(write(tmp_path / "in.tif", raw, describe=describe), tmp_path / "out.tif", PLAIN)
    model = result.fitted.model
    assert model.indexes[0].level == pytest.approx(raw[3].min() * 2e-4 - 0.05, rel=1e-5)
    with rasterio.open(tmp_path / "out.tif") as dataset:
        assert dataset.scales == (2e-4,) * 4
        assert dataset.offsets == (-0.05,) * 4
        assert dataset.units == ("reflectance",) * 4
        out = dataset.read()
    expected = expected_of(raw, model, 2e-4, -0.05)
    assert np.abs(out - expected).max() < (0.51 if np.dtype(dtype).kind in "iu" else 0.01)
    again = library.open_scene(tmp_path / "out.tif").read()
    physical = library.apply(library.open_scene(tmp_path / "in.tif").read(), model)
    np.testing.assert_allclose(again, physical, atol=1.1e-4)


def test_float64_keeps_what_float32_could_not(sea, write, read, tmp_path):
    raw = sea(dtype="float64") + 1e8
    result = remove_glint(write(tmp_path / "in.tif", raw), tmp_path / "out.tif", PLAIN)
    small = remove_glint(write(tmp_path / "b.tif", raw - 1e8), tmp_path / "b_out.tif", PLAIN)
    slopes = [f.slope for f in result.fitted.model.fits]
    assert slopes == pytest.approx([f.slope for f in small.fitted.model.fits], rel=1e-6)
    np.testing.assert_allclose(read(tmp_path / "out.tif") - 1e8, read(tmp_path / "b_out.tif"), atol=2e-3)


@pytest.mark.parametrize(
    ("dtype", "nodata"), [("uint16", 0), ("uint16", 65535), ("int16", -32768), ("float32", -9999.0), ("float64", 0.0)]
)
def test_nodata_as_a_number_passes_and_nothing_becomes_it(sea, write, read, tmp_path, dtype, nodata):
    raw = sea(dtype=dtype)
    holes = np.random.default_rng(1).random(raw.shape[1:]) < 0.2
    raw[:, holes] = nodata
    raw[1, 5:9] = nodata  # in one band only
    result = remove_glint(write(tmp_path / "in.tif", raw, nodata=nodata), tmp_path / "out.tif", PLAIN)
    out = read(tmp_path / "out.tif")
    np.testing.assert_array_equal(out == nodata, raw == nodata)
    assert result.counts.nodata == np.count_nonzero(raw[3] == nodata)
    assert result.counts.corrected == raw[3].size - result.counts.nodata
    with rasterio.open(tmp_path / "out.tif") as dataset:
        assert dataset.nodata == nodata


@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32"])
def test_a_corrected_number_moves_off_nodata(dtype):
    values = np.array([-3.0, -0.2, 0.0, 0.3, 0.9, 7.0])[None]
    raw = np.full(values.shape, 9, dtype)
    where = np.array([[True, True, True, True, True, True]])
    _, clipped = encode(values, raw, scale=1.0, offset=0.0, where=where, nodata=0.0)
    assert not (raw == 0).any()
    if dtype == "uint8":
        assert raw.ravel().tolist() == [1, 1, 1, 1, 1, 7]
        assert clipped.sum() == 4
    if dtype == "float32":
        np.testing.assert_allclose(raw, values, rtol=1e-6, atol=1e-30)


def test_pixels_whose_nir_is_nodata_are_copied(sea, write, read, tmp_path):
    raw = sea(dtype="float32")
    raw[3, 10:20] = np.nan
    raw[0, 30:40] = np.nan
    raw[1, 50, 50] = np.inf
    raw[3, 60, 60] = -np.inf
    result = remove_glint(write(tmp_path / "in.tif", raw, nodata=np.nan), tmp_path / "out.tif", PLAIN)
    out = read(tmp_path / "out.tif")
    np.testing.assert_array_equal(out[:, 10:20], raw[:, 10:20])
    np.testing.assert_array_equal(out[:, 60, 60], raw[:, 60, 60])
    np.testing.assert_array_equal(out[0, 30:40], raw[0, 30:40])
    assert out[1, 50, 50] == np.inf
    assert (out[1, 30:40] != raw[1, 30:40]).all()
    np.testing.assert_array_equal(np.isfinite(out), np.isfinite(raw))
    assert result.counts.nodata == 1001
    with rasterio.open(tmp_path / "out.tif") as dataset:
        assert np.isnan(dataset.nodata)


@pytest.mark.parametrize("internal", ["mask", "alpha"])
def test_a_mask_is_kept_and_says_what_is_not_valid(sea, write, read, tmp_path, internal):
    raw = sea()
    mask = np.full(raw.shape[1:], 255, np.uint8)
    mask[10:30, 20:50] = 0
    if internal == "mask":
        source = write(tmp_path / "in.tif", raw, mask=mask)
    else:
        with_alpha = np.concatenate([raw, mask[None].astype(raw.dtype)])
        colours = [ColorInterp.blue, ColorInterp.green, ColorInterp.red, ColorInterp.undefined, ColorInterp.alpha]
        source = write(tmp_path / "in.tif", with_alpha, describe=lambda d: setattr(d, "colorinterp", colours))
    result = remove_glint(source, tmp_path / "out.tif", PLAIN)
    with rasterio.open(tmp_path / "out.tif") as dataset:
        assert dataset.count == 4
        np.testing.assert_array_equal(dataset.read_masks(), np.broadcast_to(mask, raw.shape))
        out = dataset.read()
    np.testing.assert_array_equal(out[:, mask == 0], raw[:, mask == 0])
    assert result.counts.nodata == np.count_nonzero(mask == 0)
    assert (out[:3, mask == 255] != raw[:3, mask == 255]).mean() > 0.5
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.tif", "out.tif", "out.tif.json"]


def test_float_to_integer_keeps_nodata_as_a_mask_and_counts_what_is_clipped(sea, write, tmp_path):
    raw = sea(dtype="float32")
    raw[:, :10] = np.nan
    raw[3, 20, 20:30] = 300.0
    raw[0, 30, 30:35] = 70_000.0
    result = remove_glint(write(tmp_path / "in.tif", raw, nodata=np.nan), tmp_path / "out.tif", PLAIN, dtype="uint8")
    with rasterio.open(tmp_path / "out.tif") as dataset:
        assert dataset.nodata is None
        np.testing.assert_array_equal(dataset.read_masks(1) == 0, np.isnan(raw[3]))
        out = dataset.read()
    expected = expected_of(raw, result.fitted.model)
    good = np.isfinite(expected)
    np.testing.assert_allclose(out[good], np.rint(expected[good]).clip(0, 255), atol=1)
    lost = [int(np.count_nonzero(np.rint(b[g]) > 255)) for b, g in zip(expected, good, strict=True)]
    assert list(result.sidecar["pixels"]["clipped"].values()) == lost
    assert result.sidecar["pixels"]["clipped"]["nir"] > 0


@pytest.mark.parametrize(("factor", "dtype"), [(1e-4, "uint16"), (100, "uint8")])
def test_a_type_that_would_keep_almost_nothing_is_refused(sea, write, tmp_path, factor, dtype):
    path = write(tmp_path / "in.tif", sea(dtype="float32") * np.float32(factor))
    with pytest.raises(InputError, match="keep almost nothing"):
        remove_glint(path, tmp_path / "out.tif", PLAIN, dtype=dtype)


def test_float_to_integer_makes_what_is_not_finite_nodata(sea, write, read, tmp_path):
    raw = sea(dtype="float32")
    raw[:, :10] = np.nan
    raw[:, 10:15] = -9999
    raw[1, 40, 3] = np.inf
    raw[:, 20], raw[:, 21] = np.finfo(np.float32).max, -np.finfo(np.float32).max
    remove_glint(write(tmp_path / "in.tif", raw, nodata=-9999), tmp_path / "out.tif", PLAIN, dtype="int16")
    with rasterio.open(tmp_path / "out.tif") as dataset:
        assert dataset.nodata == -9999
    np.testing.assert_array_equal(
        read(tmp_path / "out.tif") == -9999, ~np.isfinite(raw) | (raw == -9999) | (np.abs(raw) > 3e38)
    )


def test_numbers_that_mean_nodata_are_masked_in_an_integer_output(sea, write, read, tmp_path):
    raw = sea(dtype="float32")
    raw[:, 20], raw[:, 21] = np.finfo(np.float32).max, -np.finfo(np.float32).max
    paths = {"flags": tmp_path / "flags.tif", "dtype": "uint16"}
    said = remove_glint(write(tmp_path / "in.tif", raw), tmp_path / "out.tif", PLAIN, **paths).sidecar
    with rasterio.open(tmp_path / "out.tif") as dataset:
        np.testing.assert_array_equal(dataset.read_masks(1) == 0, read(tmp_path / "flags.tif")[0] == 1)
    assert said["pixels"]["nodata"] == 200
    assert not any(said["pixels"]["clipped"].values())


@pytest.mark.parametrize(("dtype", "value"), [("float32", 0.3), ("float64", -2.0), ("int16", -5)])
def test_a_copied_number_moves_off_nodata_when_it_is_rounded_or_clipped(sea, write, read, tmp_path, dtype, value):
    raw = sea(dtype=dtype)
    raw[:, :10], raw[:3, 60:65] = 0, value
    recipe = Recipe(method="hedley", sample="all", mask="0,0,100,50", compensate="off")
    source = write(tmp_path / "in.tif", raw, nodata=0)
    said = remove_glint(source, tmp_path / "out.tif", recipe, dtype="uint16").sidecar
    np.testing.assert_array_equal(read(tmp_path / "out.tif") == 0, raw == 0)
    assert said["pixels"]["clipped"] == {"blue": 500, "green": 500, "red": 500, "nir": 0}


@pytest.mark.parametrize(
    ("dtype", "values", "expected", "clipped"),
    [
        ("uint8", np.array([-1.0, 0.5, 1.5, 255.4, 256, np.nan, np.inf, -np.inf]), [0, 0, 2, 255, 255, 0, 0, 0], 2),
        ("int16", np.array([0, 32767, 32768, 65535], np.uint16), [0, 32767, 32767, 32767], 2),
        ("int32", np.array([5e9, -5e9, 7.4], np.float32), [2147483647, -2147483648, 7], 2),
        ("uint32", np.array([5e9, -1.0, 7.4], np.float32), [4294967295, 0, 7], 2),
        ("float32", np.array([1e300, 1.5]), [np.inf, 1.5], 0),
    ],
)
def test_other_types_saturate_and_never_wrap(dtype, values, expected, clipped):
    out, lost = retype(values[None, None], np.dtype(dtype))
    assert out.dtype == dtype
    assert out.ravel().tolist() == expected
    assert (0 if lost is None else np.count_nonzero(lost)) == clipped


def test_dtype_float32_keeps_fractions(sea, write, read, tmp_path):
    raw = sea()
    result = remove_glint(write(tmp_path / "in.tif", raw, nodata=0), tmp_path / "out.tif", PLAIN, dtype="float32")
    out = read(tmp_path / "out.tif")
    assert out.dtype == np.float32
    np.testing.assert_allclose(out, expected_of(raw, result.fitted.model), rtol=3e-7)
    with rasterio.open(tmp_path / "out.tif") as dataset:
        assert dataset.nodata == 0


def test_bands_with_different_nodata_agree_in_the_output(sea, write, read, tmp_path):
    paths = []
    raw = sea(dtype="int16")
    for i, (name, nodata) in enumerate(zip(("blue", "green", "red", "nir"), (-1, -2, None, -1), strict=True)):
        if nodata is not None:
            raw[i, i * 5 : i * 5 + 5] = nodata
        paths.append(write(tmp_path / f"{name}.tif", raw[i : i + 1], names=[name], nodata=nodata))
    remove_glint(paths, tmp_path / "out.tif", PLAIN)
    with rasterio.open(tmp_path / "out.tif") as dataset:
        assert set(dataset.nodatavals) == {-1}
        np.testing.assert_array_equal(dataset.read() == -1, (raw == -1) | (raw == -2))


@pytest.mark.parametrize("dtype", ["uint16", "float32"])
def test_a_band_without_nodata_keeps_the_number_that_is_nodata_in_another(sea, write, read, tmp_path, dtype):
    raw = sea(dtype=dtype)
    raw[:, :10], raw[3, 50:60] = 0, 0
    paths = [
        write(tmp_path / f"{name}.tif", raw[i : i + 1], names=[name], nodata=None if name == "nir" else 0)
        for i, name in enumerate(("blue", "green", "red", "nir"))
    ]
    remove_glint(paths, tmp_path / "out.tif", Recipe(method="hedley", sample="0,60,90,20", mask="none"))
    out = read(tmp_path / "out.tif")
    np.testing.assert_array_equal(out[3], np.where(raw[3] == 0, out[3], raw[3]))
    assert (out[3, 50:60] != 0).all()
    np.testing.assert_allclose(out[3, 50:60], 0, atol=1)
    assert (out[:, :10] == 0).all()


def test_nodata_that_float32_rounds_is_found_beside_bands_of_float64(sea, write, read, tmp_path):
    raw = sea(dtype="float64")
    raw[:, 5] = -9999.9
    paths = [write(tmp_path / "a.tif", raw[:3].astype(np.float32)), write(tmp_path / "b.tif", raw[3:], names=["nir"])]
    scene = library.open_scene(paths, nodata=-9999.9)
    np.testing.assert_array_equal(np.isnan(scene.read()), raw < 0)
    remove_glint(paths, tmp_path / "out.tif", PLAIN, nodata=-9999.9)
    with rasterio.open(tmp_path / "out.tif") as dataset:
        np.testing.assert_array_equal(dataset.read() == dataset.nodata, raw < 0)


def test_nodata_beyond_float32_becomes_nan_without_a_warning(sea, write, tmp_path, recwarn):
    source = write(tmp_path / "in.tif", sea(dtype="float64"), nodata=-1e300)
    remove_glint(source, tmp_path / "out.tif", PLAIN, dtype="float32")
    with rasterio.open(tmp_path / "out.tif") as dataset:
        assert np.isnan(dataset.nodata)
    assert not [w for w in recwarn if "overflow" in str(w.message)]


@pytest.mark.parametrize("bands", [1, 3])
@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_few_bands_of_bytes_make_no_colours_of_their_own(sea, write, tmp_path, bands, dtype):
    cogeo = pytest.importorskip("rio_cogeo")
    raw = sea_in(sea, dtype)[-bands - 1 :]
    source = write(tmp_path / "in.tif", raw, names=("blue", "green", "red", "nir")[-bands - 1 :])
    remove_glint(source, tmp_path / "out.tif", PLAIN, flags=tmp_path / "f.tif", amount=tmp_path / "a.tif")
    for name in ("out.tif", "f.tif", "a.tif"):
        assert cogeo.cog_validate(tmp_path / name, quiet=True)[0]
    with rasterio.open(tmp_path / "out.tif") as dataset:
        assert dataset.count == bands + 1
        assert dataset.mask_flag_enums == ([rasterio.enums.MaskFlags.all_valid],) * (bands + 1)


def test_flags_say_what_was_done_to_each_pixel(sea, write, read, geojson, tmp_path):
    raw = sea()
    raw[:, 5:10] = 0
    raw[0, 20, 20:30] = 65535
    raw[2, 40, 40:50] = 20
    raw[3, 40, 40:50] = 3000
    source = write(tmp_path / "in.tif", raw, nodata=0)
    recipe = Recipe(method="hedley", sample="0,50,100,30", mask="0,0,60,80", compensate="off")
    result = remove_glint(source, tmp_path / "out.tif", recipe, flags=tmp_path / "flags.tif")
    flags = read(tmp_path / "flags.tif")[0]
    expected = expected_of(raw, result.fitted.model)
    inside = np.zeros(raw.shape[1:], bool)
    inside[:, :60] = True
    nodata = raw[3] == 0
    corrected = inside & ~nodata
    np.testing.assert_array_equal(flags & 1 != 0, nodata)
    np.testing.assert_array_equal(flags & 2 != 0, ~nodata & ~inside)
    np.testing.assert_array_equal(flags & 4 != 0, corrected)
    np.testing.assert_array_equal(flags & 8 != 0, corrected & (expected[:3] < 0).any(axis=0))
    np.testing.assert_array_equal(flags & 16 != 0, (raw == 65535).any(axis=0))
    np.testing.assert_array_equal(flags & 32 != 0, corrected & (np.rint(expected[:3]) < 1).any(axis=0))
    assert (flags & 8).any()
    assert (flags & 32).any()
    counts = result.sidecar["pixels"]
    assert counts["total"] == flags.size
    assert counts["corrected"] == np.count_nonzero(corrected)
    assert counts["nodata"] == np.count_nonzero(nodata)
    assert counts["not_water"] == np.count_nonzero(~nodata & ~inside)
    assert counts["saturated_before"] == {"blue": 10, "green": 0, "red": 0, "nir": 0}
    assert counts["negative_after"]["red"] == np.count_nonzero(corrected & (expected[2] < 0))
    np.testing.assert_array_equal(read(tmp_path / "out.tif")[:, ~corrected], raw[:, ~corrected])
    with rasterio.open(tmp_path / "flags.tif") as dataset:
        assert dataset.dtypes == ("uint8", "uint8")
        assert dataset.crs.to_epsg() == 32653
    assert sorted(FLAGS) == [1, 2, 4, 8, 16, 32, 64, 128]


@pytest.mark.parametrize("compensate", ["off", "identify-level:5, replace-level"])
@pytest.mark.parametrize(
    ("scale", "offset"), [(1.0, 0.0), (1e-4, -0.1), (3e-4, 0.7), (1e-4, 0.0), (2.75e-5, -0.2), (0.0123, 1.0)]
)
def test_saturated_values_are_counted_whatever_their_scale(sea, write, tmp_path, scale, offset, compensate):
    raw = sea()
    full, below = 65535, 65534
    raw[0, 40, 40:47], raw[1, 7, 7], raw[2, 60, 50:53], raw[3, 40, 40:42] = full, below, full, full

    def describe(dataset):
        dataset.scales, dataset.offsets = [scale] * 4, [offset] * 4

    recipe = Recipe(method="hedley", sample="0,50,100,30", mask="none", compensate=compensate)
    result = remove_glint(write(tmp_path / "in.tif", raw, describe=describe), tmp_path / "out.tif", recipe)
    assert result.sidecar["pixels"]["saturated_before"] == {"blue": 7, "green": 0, "red": 3, "nir": 2}


@pytest.mark.parametrize("compensate", ["off", "identify-level:5, replace-level"])
@pytest.mark.parametrize("full", [0.3, 0.7])  # as float32 a little more, and a little less
def test_saturated_values_are_counted_as_they_are_rounded(sea, write, tmp_path, full, compensate):
    raw = (sea() * 1e-5).clip(0, 0.25).astype(np.float32)
    raw[0, 40, 40:47], raw[1, 7, 7] = full, np.nextafter(np.float32(full), np.float32(0))
    source = write(tmp_path / "in.tif", raw, describe=lambda d: d.update_tags(FULL_SCALE=str(full)))
    recipe = Recipe(method="hedley", sample="0,50,100,30", mask="none", compensate=compensate)
    result = remove_glint(source, tmp_path / "out.tif", recipe)
    assert result.sidecar["pixels"]["saturated_before"] == {"blue": 7, "green": 0, "red": 0, "nir": 0}


def test_the_amount_of_scaled_integers_is_in_physical_units(sea, write, read, tmp_path):
    raw = sea()
    source = write(tmp_path / "in.tif", raw, describe=lambda d: setattr(d, "scales", [1e-4] * 4))
    result = remove_glint(source, tmp_path / "out.tif", PLAIN, amount=tmp_path / "amount.tif")
    expected = (raw - expected_of(raw, result.fitted.model, 1e-4))[:3] * 1e-4
    np.testing.assert_allclose(read(tmp_path / "amount.tif"), expected, atol=1e-6)


def test_the_amount_of_large_integers_keeps_its_digits(sea, write, read, tmp_path):
    raw = sea(dtype="uint32") + np.uint32(2_000_000_000)
    remove_glint(write(tmp_path / "in.tif", raw), tmp_path / "out.tif", PLAIN, amount=tmp_path / "amount.tif")
    removed = (raw.astype(np.int64) - read(tmp_path / "out.tif"))[:3]
    np.testing.assert_allclose(read(tmp_path / "amount.tif"), removed, atol=0.51)
