"""xarray in and out: the numbers of the tile engine, lazily, from what the usual openers give."""

import pickle
import sys
import warnings
from collections import Counter
from dataclasses import replace
from inspect import signature

import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from hypothesis import strategies as st

import deglint.xr
import detect.xr
from deglint import Recipe, remove_glint
from deglint.errors import BandError, DeglintError, InputError
from deglint.readers.arrays import open_array
from detect.pipeline import Recipe as Scoring
from detect.pipeline import score_file

from .common import HEDLEY, NAMES, WATER, says

xarray = pytest.importorskip("xarray", reason="needs pip install 'deglint[xarray]'")
rioxarray = pytest.importorskip("rioxarray", reason="needs pip install 'deglint[xarray]'")
dask = pytest.importorskip("dask", reason="needs pip install 'deglint[xarray]'")

CHAIN = Recipe(compensate="identify-level:7, replace-level, remove, identify-level:5, replace-level")
CHUNKS = [None, {"band": 1, "y": 128, "x": 128}, {"band": 4, "y": 45, "x": 1000}]


@pytest.fixture
def scene(sea, write, tmp_path):
    def make(dtype="uint16", **options):
        raw = sea(230, 260, dtype=dtype)
        raw[:, 100:150, 60:130] = 6000
        raw[:, 180:183, 200:206] = 9000
        raw[:, :30, :50] = 0
        return write(tmp_path / "in.tif", raw, **options)

    return make


def opened(path, chunks):
    with rioxarray.open_rasterio(path, chunks=chunks) as found:
        return found.load() if chunks is None else found


def by_file(source, tmp_path, recipe, **options):
    remove_glint(source, tmp_path / "out.tif", recipe, overwrite=True, **options)
    with rasterio.open(tmp_path / "out.tif") as dataset:
        return dataset.read()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("recipe", "dtype", "nodata"),
    [(Recipe(), "uint16", 0), (HEDLEY, "float32", None), (HEDLEY, "float64", -9999.0), (CHAIN, "uint16", 0),
     (CHAIN, "float32", None)],
    ids=["auto", "hedley", "hedley, nodata", "chain", "chain, float32"],
)  # fmt: skip
def test_the_numbers_of_the_tile_engine(scene, tmp_path, recipe, dtype, nodata):
    source = scene(dtype, nodata=nodata)
    expected = by_file(source, tmp_path, recipe)
    for chunks in CHUNKS:
        given = opened(source, chunks)
        before = given.copy(deep=True) if chunks is None else None
        clean = deglint.xr.remove(given, recipe)
        assert (clean.chunks is None) == (chunks is None)
        np.testing.assert_array_equal(clean.values, expected)
        assert clean.dtype == given.dtype
        assert clean.attrs == given.attrs
        assert clean.dims == given.dims
        assert clean.rio.crs == given.rio.crs
        assert clean.rio.transform() == given.rio.transform()
        xarray.testing.assert_equal(clean.coords.to_dataset(), given.coords.to_dataset())
        if before is not None:
            xarray.testing.assert_identical(given, before)


@pytest.mark.slow
def test_the_neighbours_of_the_nir_are_followed_over_the_edges_of_chunks(sea, write, tmp_path):
    from scipy.ndimage import gaussian_filter

    glint = gaussian_filter(np.random.default_rng(0).gamma(0.5, 900.0, (260, 300)), 1.5)
    raw = sea(256, 296, dtype="float32") * 0.02 + WATER
    for i, move in enumerate((3, 2, 1, 0)):
        raw[i] += glint[move : move + 256, :296]
    source = write(tmp_path / "in.tif", raw.astype(np.float32))
    given = opened(source, {"band": 4, "y": 60, "x": 70})
    fitted = deglint.xr.fit(given)
    assert fitted.model.halo > 0
    np.testing.assert_array_equal(deglint.xr.apply(given, fitted).values, by_file(source, tmp_path, Recipe()))


def test_integers_can_become_real_numbers(scene, tmp_path):
    source = scene()
    expected = by_file(source, tmp_path, HEDLEY, dtype="float32")
    clean = deglint.xr.remove(opened(source, 100), HEDLEY, dtype="float32")
    assert clean.dtype == np.float32
    np.testing.assert_array_equal(clean.values, expected)
    with pytest.raises(InputError, match="the array's own uint16"):
        deglint.xr.remove(opened(source, 100), HEDLEY, dtype="int16")


@pytest.mark.slow
@pytest.mark.parametrize("recipe", [Scoring(), Scoring(mask="water"), Scoring(covariance="ledoit-wolf"),
                                    Scoring(method="local", window=(3, 21), mask="water")])  # fmt: skip
def test_scores_are_those_of_the_tile_engine(scene, tmp_path, recipe):
    source = scene(nodata=0)
    score_file(source, tmp_path / "out.tif", recipe)
    with rasterio.open(tmp_path / "out.tif") as dataset:
        expected = dataset.read(1)
    for chunks in CHUNKS:
        given = opened(source, chunks)
        scores = detect.xr.score(given, recipe)
        np.testing.assert_array_equal(scores.values, expected)
        assert scores.dims == ("y", "x")
        assert scores.rio.crs == given.rio.crs
        assert "band" not in scores.coords


def test_rx_with_a_background_of_another_scene(scene):
    given = opened(scene(nodata=0), 100)
    background = detect.xr.fit(given.isel(y=slice(150, None)))
    assert background.names == ("blue", "green", "red", "nir")
    scores = detect.xr.rx(given, background).values
    again = detect.xr.rx(given[::-1], background).values
    np.testing.assert_array_equal(scores, again)
    assert not np.array_equal(scores, detect.xr.rx(given).values, equal_nan=True)


def test_a_background_is_used_or_refused(scene):
    given = opened(scene(nodata=0), 100)
    background = detect.xr.fit(given.isel(y=slice(150, None)))
    for method in ("local", "sea"):
        with pytest.raises(InputError, match="background of its own for every pixel"):
            detect.xr.score(given, Scoring(method=method, mask="none"), background=background)
    scores = detect.xr.score(given, "auto", background=background)
    np.testing.assert_array_equal(scores.values, detect.xr.rx(given, background).values)


@settings(max_examples=15)
@given(st.data())
def test_any_chunks_give_the_same(data):
    height, width = data.draw(st.integers(1, 90)), data.draw(st.integers(1, 90))
    rng = np.random.default_rng(0)
    raw = rng.gamma(2, 100, (4, height, width)).astype(np.float32)
    model = deglint.fit("hedley", rng.gamma(2, 100, (4, 20, 20)), nir=3, bands=[deglint.Band(n) for n in NAMES])
    sizes = st.integers(1, 60)
    given = xarray.DataArray(raw, dims=("band", "y", "x"), coords={"band": list(NAMES)})
    whole = deglint.xr.apply(given, model, mask="none").values
    np.testing.assert_array_equal(whole, deglint.apply(raw, model))
    chunked = given.chunk({"band": data.draw(st.integers(1, 4)), "y": data.draw(sizes), "x": data.draw(sizes)})
    np.testing.assert_array_equal(deglint.xr.apply(chunked, model, mask="none").values, whole)


def test_nothing_is_computed_before_it_is_asked_for(scene):
    from dask.array import map_blocks

    given = opened(scene(), 100)
    loads, computes = Counter(), []

    def load(block, block_id=None):
        loads[block_id] += 1
        return block

    given = given.copy(data=map_blocks(load, given.data.rechunk({0: -1}), dtype=given.dtype, meta=given.data._meta))

    def scheduler(graph, keys, **options):
        computes.append(1)
        return dask.local.get_sync(graph, keys, **options)

    fitted = deglint.xr.fit(given, CHAIN)
    background = detect.xr.fit(given)
    loads.clear()
    with dask.config.set(scheduler=scheduler):
        clean = deglint.xr.apply(given, fitted)
        scores = detect.xr.score(clean, background=background)
        assert clean.chunks is not None
        assert not computes
        assert not loads
        scores.compute()
    assert len(computes) == 1
    assert set(loads.values()) == {1}
    assert len(loads) == 9


def test_a_lazy_result_can_be_sent_to_workers(scene):
    given = opened(scene(), 100)
    clean = deglint.xr.remove(given, HEDLEY)
    carried = pickle.dumps(clean)
    assert len(carried) < given.nbytes / 2  # no task carries the array
    again = pickle.loads(carried)
    np.testing.assert_array_equal(again.values, clean.values)


def stackstac_like(raw):
    """As stackstac 0.5 gives Sentinel-2 from Earth Search: float64, time, STAC's electro-optical fields."""
    _, height, width = raw.shape
    return xarray.DataArray(
        raw[None].astype(np.float64), dims=("time", "band", "y", "x"), name="stackstac-0123",
        coords={
            "time": [np.datetime64("2023-06-01")], "id": ("time", ["S2A_1"]), "band": list(NAMES),
            "x": 400_000.0 + 10 * np.arange(width), "y": 800_000.0 - 10 * np.arange(height),
            "epsg": 32653, "proj:epsg": 32653, "platform": "sentinel-2a",
            "common_name": ("band", list(NAMES)), "center_wavelength": ("band", [0.4966, 0.56, 0.6645, 0.8351]),
            "full_width_half_max": ("band", [0.098, 0.045, 0.038, 0.145]), "proj:shape": ((), {70, 80}),
            "title": ("band", ["Band 2 (blue)", "Band 3 (green)", "Band 4 (red)", "Band 8 (nir)"]),
        },
        attrs={"spec": "RasterSpec()", "crs": "epsg:32653", "resolution": 10.0,
               "transform": (10.0, 0.0, 400_000.0, 0.0, -10.0, 800_000.0, 0.0, 0.0, 1.0)},
    )  # fmt: skip


def odc_like(raw, names=("B02", "B03", "B04", "B08")):
    """As odc-stac gives it: a Dataset of one variable a band."""
    _, height, width = raw.shape
    wkt = rasterio.crs.CRS.from_epsg(32653).to_wkt()
    place = {"crs_wkt": wkt, "GeoTransform": "400000 10 0 800000 0 -10", "grid_mapping_name": "transverse_mercator"}
    coords = {
        "y": 800_000 - 5 - 10.0 * np.arange(height), "x": 400_000 + 5 + 10.0 * np.arange(width),
        "spatial_ref": xarray.DataArray(32653, attrs=place), "time": [np.datetime64("2023-06-01")],
    }  # fmt: skip
    attrs = {"nodata": 0, "grid_mapping": "spatial_ref"}
    return xarray.Dataset({n: (("time", "y", "x"), raw[i][None], attrs) for i, n in enumerate(names)}, coords=coords)


def test_what_stackstac_gives(sea):
    raw = sea(150, 160)
    given = stackstac_like(raw)
    found = open_array(given).scene
    assert [b.wavelength for b in found.bands] == [496.6, 560.0, 664.5, 835.1]
    assert [b.width for b in found.bands] == [98.0, 45.0, 38.0, 145.0]
    assert found.names == NAMES
    assert found.crs.to_epsg() == 32653
    assert found.transform == rasterio.Affine(10, 0, 400_000, 0, -10, 800_000)
    clean = deglint.xr.remove(given.chunk({"y": 64, "x": 64}), HEDLEY)
    model = deglint.fit("hedley", raw.astype(np.float64), nir=3, bands=found.bands)
    np.testing.assert_array_equal(clean.values[0], deglint.apply(raw.astype(np.float64), model))
    xarray.testing.assert_equal(clean.coords.to_dataset(), given.coords.to_dataset())
    assert clean.dims == given.dims


def test_what_odc_stac_gives(sea):
    raw = sea(150, 160)
    raw[:, :20, :20] = 0
    given = odc_like(raw).chunk({"y": 64})
    found = open_array(deglint.xr.stack(given)).scene
    assert [b.wavelength for b in found.bands] == pytest.approx([492.7, 559.8, 664.6, 832.8], abs=1)
    assert found.source.info.nodatas == (0.0,) * 4
    assert found.crs.to_epsg() == 32653
    assert found.transform == rasterio.Affine(10, 0, 400_000, 0, -10, 800_000)
    clean = deglint.xr.remove(given, HEDLEY)
    assert isinstance(clean, xarray.Dataset)
    assert clean.B03.attrs == given.B03.attrs
    assert clean.B03.chunks is not None
    np.testing.assert_array_equal(clean.B08.values, given.B08.values)
    np.testing.assert_array_equal(clean.B03.values[0, :20, :20], 0)
    assert clean.B03.values[0, 20:].std() < 0.1 * raw[1, 20:].std()
    whole = deglint.xr.remove(deglint.xr.stack(given).compute(), HEDLEY)
    np.testing.assert_array_equal(clean.B03.values, whole.sel(band="B03").values)


def test_a_time_series_with_masks_is_taken_as_it_comes(sea, caplog):
    first, second = odc_like(sea(150, 160)), odc_like(sea(150, 160, seed=1))
    given = xarray.concat([first, second], "time").assign_coords(time=np.arange(2).astype("datetime64[D]"))
    given["SCL"] = given.B02.astype("uint8") % 2
    clean = given.chunk({"y": 64}).deglint.remove(HEDLEY)
    assert clean.B03.chunks is not None
    for i, one in enumerate((first, second)):
        alone = deglint.xr.remove(one, HEDLEY)
        for name in one.data_vars:
            np.testing.assert_array_equal(clean[name].values[i], alone[name].values[0])
    np.testing.assert_array_equal(clean.SCL.values, given.SCL.values)
    given = given.drop_vars("SCL")
    given.B08[0] = given.B04[0] = given.B03[0] = given.B02[0] = 0
    left = given.deglint.remove("hedley")
    np.testing.assert_array_equal(left.B03.values[0], 0)
    assert left.B03.values[1].std() < given.B03.values[1].std()
    assert "1970-01-01T00:00:00" in caplog.text


def test_the_accessor_is_the_functions(sea):
    given = stackstac_like(sea(90, 100))
    clean = deglint.xr.remove(given, HEDLEY)
    xarray.testing.assert_identical(given.deglint.remove(HEDLEY), clean)
    xarray.testing.assert_identical(given.deglint.apply(given.deglint.fit(HEDLEY)), clean)
    held = given.to_dataset(name="scene").assign(cloud=given.isel(band=0, drop=True))
    xarray.testing.assert_identical(held.deglint.remove(HEDLEY).scene.drop_attrs(), clean.rename("scene").drop_attrs())
    several = odc_like(sea(90, 100))
    fitted = several.deglint.fit(HEDLEY)
    xarray.testing.assert_identical(several.deglint.apply(fitted), deglint.xr.remove(several, HEDLEY))


def test_an_array_without_names_gets_a_remedy_for_arrays(sea):
    array = xarray.DataArray(np.concatenate([sea(), sea()[:1]]), dims=("band", "y", "x"))
    with pytest.raises(BandError, match="long_name") as raised:
        deglint.xr.remove(array)
    assert "--" not in str(raised.value)
    named = array.assign_attrs(long_name=[*NAMES, "more"])
    waves = array.assign_coords(wavelength=("band", [480.0, 560.0, 660.0, 850.0, 1600.0]))
    for mended in (named, waves):
        assert deglint.xr.fit(mended, HEDLEY).model.fits


def test_variables_may_have_numbers_as_names(sea):
    """As `to_dataset("band")` of an array from rioxarray gives them."""
    bands = [(("y", "x"), band, {"long_name": NAMES}) for band in sea(60, 70)]
    named = deglint.xr.remove(xarray.Dataset(dict(zip(NAMES, bands, strict=True))), HEDLEY)
    clean = deglint.xr.remove(xarray.Dataset(dict(enumerate(bands, 1))), HEDLEY)
    for n, name in enumerate(NAMES, 1):
        np.testing.assert_array_equal(clean[n], named[name])


@pytest.mark.parametrize("place", ["attrs", "encoding"])
def test_variables_keep_the_nodata_and_the_scale_of_their_own(sea, place):
    raw = sea(60, 70)
    given = xarray.Dataset({name: (("y", "x"), band) for name, band in zip(NAMES, raw, strict=True)})
    expected = deglint.xr.remove(given.isel(y=slice(9, None)).copy(deep=True), HEDLEY)
    for i, band in enumerate(given.data_vars.values()):
        band.values[:9] = 60_000 + i
        getattr(band, place)["_FillValue"] = 60_000 + i
    given.nir.values[9:] //= 2
    given.nir.attrs["scale_factor"] = 2.0
    for clean in (deglint.xr.remove(given, HEDLEY), deglint.xr.remove(given.chunk({"y": 30}), HEDLEY)):
        for i, name in enumerate(NAMES):
            np.testing.assert_array_equal(clean[name].values[:9], 60_000 + i)
        off = clean.green.values[9:].astype(float) - expected.green.values
        assert np.abs(off).max() < 5  # the NIR is rounded to even numbers


@pytest.mark.parametrize("name", ["data", "reflectance"])
def test_a_dataset_of_one_image_and_tables_of_its_bands(sea, name):
    image = xarray.DataArray(sea(60, 70), dims=("band", "y", "x"), coords={"band": list(NAMES)})
    held = xarray.Dataset({name: image, "wavelength": ("band", [480.0, 560.0, 660.0, 850.0])})
    clean = held.deglint.apply(held.deglint.fit(HEDLEY))
    np.testing.assert_array_equal(clean[name].values, deglint.xr.remove(image, HEDLEY).values)
    xarray.testing.assert_identical(held.deglint.remove(HEDLEY), clean)
    with pytest.raises(InputError, match=f"{name}, other .*bands of their own"):
        held.assign(other=image).deglint.fit(HEDLEY)


def test_an_entry_without_a_fit_is_copied_as_one_without_water(sea, caplog):
    one = xarray.DataArray(sea(60, 70, dtype="float32"), dims=("band", "y", "x"), coords={"band": list(NAMES)})
    clean = deglint.xr.remove(xarray.concat([one * np.nan, one], "time"), HEDLEY)
    assert np.isnan(clean.values[0]).all()
    np.testing.assert_array_equal(clean.values[1], deglint.xr.remove(one, HEDLEY).values)
    assert says(caplog.text, "not corrected", "0 valid pixels")


def test_a_lazy_array_smaller_than_the_halo_is_scored_as_a_whole_one(sea):
    given = xarray.DataArray(sea(60, 70), dims=("band", "y", "x"), coords={"band": list(NAMES)})
    expected = detect.xr.score(given, Scoring(method="sea", mask="none"))
    lazy = detect.xr.score(given.chunk({"y": 30, "x": 30}), Scoring(method="sea", mask="none"))
    np.testing.assert_array_equal(lazy.values, expected.values)


def test_undeclared_nodata_has_no_score_also_with_a_given_background(sea):
    raw = sea(60, 70)
    raw[:, :, :20] = 0
    given = xarray.DataArray(raw, dims=("band", "y", "x"), coords={"band": list(NAMES)})
    scores = detect.xr.rx(given, detect.xr.fit(given))
    np.testing.assert_array_equal(scores.values, detect.xr.rx(given).values)
    assert np.isnan(scores.values[:, :20]).all()


def test_dimensions_in_any_order(sea):
    raw = sea(70, 80)
    given = xarray.DataArray(raw, dims=("band", "y", "x"), coords={"band": list(NAMES)})
    clean = deglint.xr.remove(given, HEDLEY)
    for dims in [("y", "x", "band"), ("x", "band", "y"), ("y", "band", "x")]:
        turned = deglint.xr.remove(given.transpose(*dims), HEDLEY)
        assert turned.dims == dims
        np.testing.assert_array_equal(turned.transpose("band", "y", "x").values, clean.values)
    named = given.rename(y="latitude", x="longitude").expand_dims(time=1, axis=1)
    other = deglint.xr.remove(named, HEDLEY)
    assert other.dims == named.dims
    np.testing.assert_array_equal(other.values[:, 0], clean.values)


@pytest.mark.parametrize(
    ("coords", "attrs"),
    [
        ({"wavelength": ("band", [490, 560, 665, 842])}, {}),
        ({"wavelength": ("band", [0.49, 0.56, 0.665, 0.842])}, {"wavelength_units": "um"}),
        ({"common_name": ("band", list(NAMES))}, {}),
        ({}, {"wavelengths": [490.0, 560.0, 665.0, 842.0]}),
        ({}, {"long_name": NAMES}),
        ({"band": ["B02", "B03", "B04", "B08"]}, {}),
    ],
)
def test_where_wavelengths_may_stand(sea, coords, attrs):
    given = xarray.DataArray(sea(), dims=("band", "y", "x"), coords=coords, attrs=attrs)
    waves = [b.wavelength for b in open_array(given).scene.bands]
    np.testing.assert_allclose(waves, (490, 560, 665, 842), atol=15)
    assert deglint.xr.fit(given, HEDLEY).model.index_bands == (3,)


def test_attributes_follow_the_bands_that_were_picked(scene):
    given = opened(scene(), None)
    given.attrs["wavelengths"] = [490.0, 560.0, 665.0, 842.0]
    found = open_array(given.isel(band=[3, 1])).scene
    assert [(b.name, b.wavelength) for b in found.bands] == [("nir", 842.0), ("green", 560.0)]
    assert open_array(given.sel(band=3)).scene.bands[0].name == "red"
    assert open_array(given.sel(band=3)).scene.bands[0].wavelength == 665.0
    turned = deglint.xr.remove(given[::-1], HEDLEY)
    np.testing.assert_array_equal(turned[::-1].values, deglint.xr.remove(given, HEDLEY).values)


def test_decoded_and_raw_numbers_give_the_same(sea, write, tmp_path):
    def scaled(dataset):
        dataset.scales, dataset.offsets = [1e-4] * 4, [-0.1] * 4

    raw = sea(90, 100) + 1000
    raw[:, :9, :9] = 0
    source = write(tmp_path / "in.tif", raw, nodata=0, describe=scaled)
    expected = by_file(source, tmp_path, HEDLEY)
    np.testing.assert_array_equal(deglint.xr.remove(opened(source, 40), HEDLEY).values, expected)
    decoded = rioxarray.open_rasterio(source, masked=True, mask_and_scale=True).load()
    clean = deglint.xr.remove(decoded, HEDLEY)
    assert np.isnan(clean.values[:, :9, :9]).all()
    np.testing.assert_allclose(clean.values[:, 9:], expected[:, 9:] * 1e-4 - 0.1, atol=6e-5)


@pytest.mark.parametrize("nodata", ["0", "nan", True, [0]])
def test_nodata_is_a_number_or_none(sea, nodata):
    with pytest.raises(InputError, match=r'nodata .*"none".*want a number'):
        open_array(odc_like(sea())["B02"], nodata=nodata)


@pytest.mark.parametrize("dtype", ["uint8", "uint32", "int16"])
def test_coordinates_of_any_type_place_the_pixels(dtype):
    x = np.array([-32000, 0, 32000] if dtype == "int16" else [1, 2, 3], dtype)
    given = xarray.DataArray(np.ones((3, 3)), dims=("y", "x"), coords={"y": np.array([3, 2, 1], dtype), "x": x})
    step = float(x[1]) - float(x[0])
    assert open_array(given).scene.transform == rasterio.Affine(step, 0, x[0] - step / 2, 0, -1, 3.5)


@pytest.mark.parametrize("dim", ["x", "y"])
def test_coordinates_that_are_not_evenly_spaced_are_refused(dim):
    places = {d: np.array([0.0, 1, 2, 9] if d == dim else [0.0, 1, 2, 3]) for d in ("y", "x")}
    given = xarray.DataArray(np.ones((4, 4)), dims=("y", "x"), coords=places)
    with pytest.raises(InputError, match=rf"coordinates {dim} .*not evenly spaced.*drop_vars\('{dim}'\)"):
        open_array(given)
    assert open_array(given.drop_vars(dim)).scene.transform is None


def test_coordinates_that_float32_rounds_are_even():
    places = {"y": np.float32(60) - np.arange(500, dtype="float32") * np.float32(1e-4), "x": np.arange(1.0, 501.0)}
    placed = open_array(xarray.DataArray(np.ones((500, 500)), dims=("y", "x"), coords=places)).scene.transform
    assert placed.e == pytest.approx(-1e-4, rel=1e-3)


def test_a_declared_transform_is_compared_without_a_warning(sea):
    given = odc_like(sea())["B02"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert open_array(given).scene.transform is not None


def test_a_declared_transform_without_inverse_is_none(sea):
    given = odc_like(sea())["B02"]
    place = open_array(given).scene.transform
    given.spatial_ref.attrs["GeoTransform"] = "0 0 0 0 0 0"
    assert open_array(given).scene.transform == place
    assert open_array(given.drop_vars(["x", "y"])).scene.transform is None


def test_what_does_not_match_the_fit_is_said(sea):
    array = xarray.DataArray(sea(), dims=("band", "y", "x"), coords={"band": list(NAMES)})
    fitted = deglint.xr.fit(array, HEDLEY)
    with pytest.raises(InputError, match=r"fitted.*blue, green, red, nir.*array has blue, green, red"):
        deglint.xr.apply(array[:3], fitted)
    with pytest.raises(InputError, match="fitted: want a Fitted, got 'hedley'"):
        deglint.xr.apply(array, "hedley")
    with pytest.raises(InputError, match=r"^fitted: want a GlintModel.*Fitted.*fitted\.model"):
        deglint.xr.apply(array, fitted, chain=fitted.chain)
    with pytest.raises(InputError, match="chain: want a Chain, got 'thesis'"):
        deglint.xr.apply(array, fitted.model, chain="thesis")
    for fit in (fitted, fitted.model):
        with pytest.raises(InputError, match="threads: want a number from 1"):
            deglint.xr.apply(array, fit, threads=-1)


def test_a_mask_wins_over_that_of_the_fit(sea):
    array = xarray.DataArray(sea(), dims=("band", "y", "x"), coords={"band": list(NAMES)})
    fitted = deglint.xr.fit(array, HEDLEY)
    expected = array.copy()
    expected[:, 5:15, 3:23] = deglint.xr.apply(array, fitted)[:, 5:15, 3:23]
    for fit in (fitted, fitted.model):
        for mask in ("3,5,20,10", (3, 5, 20, 10)):
            np.testing.assert_array_equal(deglint.xr.apply(array, fit, mask=mask), expected)


def test_what_cannot_be_used_is_said(sea):
    given = xarray.DataArray(sea(), dims=("band", "y", "x"), coords={"band": list(NAMES)})
    with pytest.raises(InputError, match=r"one at a time.*isel\(time=0\)"):
        deglint.xr.fit(given.expand_dims(time=2))
    with pytest.raises(InputError, match="want dimensions y and x"):
        deglint.xr.remove(given.rename(y="north"))
    with pytest.raises(InputError, match="got ndarray"):
        deglint.xr.fit(given.values)
    with pytest.raises(InputError, match="complex64"):
        deglint.xr.fit(given.astype("complex64"))
    with pytest.raises(InputError, match="holds no pixel"):
        deglint.xr.fit(given[:, :0])
    with pytest.raises(InputError, match="not one of auto"):
        deglint.xr.remove(given, "guess")
    with pytest.raises(BandError, match="no near-infrared"):
        deglint.xr.remove(given.isel(band=[0, 1, 2]), HEDLEY)
    fitted = deglint.xr.fit(given, replace(HEDLEY, compensate="off"))
    with pytest.raises(InputError, match=r"Pass fitted\.model"):
        deglint.xr.apply(given[::-1], fitted)
    turned = deglint.xr.apply(given[::-1], fitted.model, mask="none")
    np.testing.assert_array_equal(turned.values[::-1], deglint.xr.apply(given, fitted).values)


@pytest.mark.parametrize("function", [deglint.xr.fit, deglint.xr.remove])
def test_the_signature_names_how_the_array_is_read(function):
    assert {"sensor", "nodata"} <= set(signature(function).parameters)
    with pytest.raises(TypeError, match="did you mean 'sensor'"):
        function(None, sensr="sentinel2")


def test_the_extra_is_named_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    for call in (deglint.xr.remove, deglint.xr.fit, detect.xr.rx, detect.xr.fit):
        with pytest.raises(DeglintError, match=r"pip install 'deglint\[xarray\]'"):
            call(None)
