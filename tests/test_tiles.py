"""Tiles and threads change nothing: the same pixels give the same bits, however they are stored and worked on."""

import math
import threading
import time

import cv2
import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from hypothesis import strategies as st
from threadpoolctl import threadpool_info, threadpool_limits

import deglint as library
from deglint import METHODS, Recipe, remove_glint, tiles
from deglint.moments import CELL
from deglint.raster.info import RasterInfo
from deglint.raster.output import Layout
from deglint.remove import REGRESSIONS

from .common import NARROW, at_wavelengths

SIDES = st.integers(1, 3000)
BLOCKS = st.one_of(
    st.sampled_from([(1, 10**6), (128, 128), (256, 256), (512, 512), (1024, 1024), (16, 10**6)]),
    st.tuples(st.integers(1, 700), st.integers(1, 700)),
)


def blocks_of(height, width, block):
    return min(block[0], height), min(block[1], width)


@settings(deadline=None, max_examples=150)
@given(SIDES, SIDES, st.integers(1, 120), BLOCKS)
def test_tiles_cover_every_pixel_once_and_stay_small(height, width, bands, block):
    shape = tiles.tile_shape(height, width, bands, blocks_of(height, width, block))
    assert shape[0] % CELL == 0
    assert shape[1] % CELL == 0 or shape[1] >= width
    held = min(shape[0], height) * min(shape[1], width) * bands
    assert held <= max(tiles.MOST_SAMPLES, CELL * CELL * bands)
    seen = np.zeros((height, width), np.uint8)
    for tile in tiles.tiles(height, width, shape):
        seen[tile.row0 : tile.row1, tile.col0 : tile.col1] += 1
        assert tile.row0 % CELL == tile.col0 % CELL == 0
    assert (seen == 1).all()


@settings(deadline=None, max_examples=150)
@given(SIDES, SIDES, st.integers(1, 120), BLOCKS, st.integers(0, 150))
def test_tiles_with_a_halo_hold_no_more_than_they_may(height, width, bands, block, halo):
    own = blocks_of(height, width, block)
    shape = tiles.tile_shape(height, width, bands, own)
    rows, columns = tiles.compact(shape, own, bands, halo)
    assert rows % CELL == 0
    assert columns % CELL == 0 or columns >= width
    held = (rows + 2 * halo) * (min(columns, width) + 2 * halo) * bands
    blocks = math.lcm(own[1], CELL)  # the file's blocks may ask for more
    assert held <= tiles.MOST_WITH_HALO or columns <= max(tiles.COMPACT, blocks) or columns >= width
    other = tiles.compact(shape, own, bands, halo // 2)
    assert other[0] == rows
    assert other[1] >= columns


def test_a_wide_halo_makes_tiles_narrow():
    """Of five bands in blocks of 512: what is held decides."""
    assert tiles.compact((512, 512), (512, 512), 5, 8) == (512, 1024)
    assert tiles.compact((512, 512), (512, 512), 5, 69) == (512, 512)
    assert tiles.compact((512, 512), (256, 256), 5, 69) == (512, 768)
    assert tiles.compact((128, 4096), (1, 4096), 5, 69) == (256, 1024)  # strips
    assert tiles.compact((512, 4096), (1, 4096), 5, 69) == (512, 768)


@settings(deadline=None, max_examples=150)
@given(SIDES, SIDES, st.integers(1, 120), BLOCKS, st.booleans())
def test_output_blocks_are_written_once(height, width, bands, block, tiled):
    own = blocks_of(height, width, block)
    shape = tiles.tile_shape(height, width, bands, own)
    fields = dict.fromkeys(("paths", "driver", "nodatas", "scales", "offsets", "descriptions", "units", "colorinterp",
                            "tags", "band_tags", "mask_flags"))  # fmt: skip
    info = RasterInfo(**fields, height=height, width=width, dtypes=("uint8",), block_shapes=(own,), tiled=tiled)
    rows, columns = Layout(info, (0,), "uint8", tile=shape).block
    assert rows % 16 == columns % 16 == 0
    assert 16 <= rows <= 1024
    assert 16 <= columns <= 1024
    assert shape[0] % rows == 0 or shape[0] >= height
    assert shape[1] % columns == 0 or shape[1] >= width


@settings(deadline=None, max_examples=100)
@given(SIDES, SIDES, st.integers(40, 600), st.integers(40, 600), st.integers(1, 10**6))
def test_a_spread_of_tiles_holds_about_what_was_asked_for(height, width, rows, columns, pixels):
    everything = tiles.tiles(height, width, (rows, columns))
    chosen = tiles.spread(everything, pixels)
    assert chosen
    assert len(set(chosen)) == len(chosen)
    assert set(chosen) <= set(everything)
    assert chosen == tiles.spread(everything, pixels)
    largest = max(t.shape[0] * t.shape[1] for t in everything)
    assert len(chosen) * largest <= max(pixels, largest) or len(chosen) == len(everything)


def test_some_of_some_tiles_can_be_taken():
    """A look is spread already: its rows hold other columns each."""
    look = tiles.spread(tiles.tiles(20_000, 20_000, (192, 192)), 4_800_000)
    some = tiles.spread(look, 300_000)
    assert set(some) <= set(look)
    assert 200_000 <= sum(t.shape[0] * t.shape[1] for t in some) <= 400_000


def test_results_come_in_order_and_few_wait():
    everything = tiles.tiles(640, 64, (64, 64))
    rng = np.random.default_rng(0)
    delays = dict(zip(everything, rng.random(len(everything)) / 100, strict=True))
    lock, at_once, most = threading.Lock(), 0, 0

    def work(tile):
        nonlocal at_once, most
        with lock:
            at_once += 1
            most = max(most, at_once)
        time.sleep(delays[tile])
        return tile.row0

    seen = []
    for tile, result in tiles.run(everything, work, threads=3):
        with lock:
            at_once -= 1
        seen.append((tile, result))
    assert seen == [(t, t.row0) for t in everything]
    assert most <= 5


def test_results_of_a_row_of_tiles_are_combined():
    everything = tiles.tiles(250, 330, (100, 100))
    found = list(tiles.by_rows(tiles.run(everything, lambda t: t.col0, threads=3), list))
    assert found == [[0, 100, 200, 300]] * 3
    assert list(tiles.by_rows(tiles.run([], lambda t: t), list)) == []


def test_what_is_kept_of_a_large_sample_is_bounded(sea, write, tmp_path, monkeypatch):
    """Standard errors of many cells are taken between groups of them; any tiling gives the same groups."""
    source = write(tmp_path / "in.tif", sea(420, 650), tiled=True, blockxsize=64, blockysize=64)
    recipe = Recipe(method="joyce", sample="all", mask="none")
    whole = library.fit_scene(library.open_scene(source), recipe).model
    monkeypatch.setattr("deglint.pipeline.sample.MOST_CELLS", 20)
    found = []
    for samples in (4 * 64 * 64, 4 * 192 * 192, 1 << 22):
        monkeypatch.setattr(tiles, "SAMPLES", samples)
        found.append(library.fit_scene(library.open_scene(source), recipe).model)
    assert found[0] == found[1] == found[2]
    for one, other in zip(found[0].fits, whole.fits, strict=True):
        assert one.slope == pytest.approx(other.slope, rel=1e-12)
        assert one.stderr == pytest.approx(other.stderr, rel=0.5)
        assert one.stderr != other.stderr


def test_a_consumer_that_leaves_stops_the_work():
    done = []
    running = tiles.run(tiles.tiles(6400, 64, (64, 64)), done.append, threads=2)
    next(running)
    running.close()
    assert len(done) < 10


STORED = {
    "strips": {},
    "rows": {"blockysize": 1},
    "tall strips": {"blockysize": 500},
    "pixel": {"interleave": "pixel"},
    "small tiles": {"tiled": True, "blockxsize": 64, "blockysize": 64},
    "odd tiles": {"tiled": True, "blockxsize": 48, "blockysize": 208},
    "wide tiles": {"tiled": True, "blockxsize": 512, "blockysize": 128, "interleave": "pixel"},
    "large tiles": {"tiled": True, "blockxsize": 1024, "blockysize": 1024},
    "deflate": {"compress": "deflate", "predictor": 2},
    "lzw tiles": {"compress": "lzw", "tiled": True, "blockxsize": 256, "blockysize": 256, "interleave": "pixel"},
    "ENVI": {"driver": "ENVI"},
}


@pytest.fixture
def small_tiles(monkeypatch):
    """Make tiles small, so that small scenes have many."""
    monkeypatch.setattr(tiles, "SAMPLES", 4 * 128 * 128)
    monkeypatch.setattr(tiles, "MOST_SAMPLES", 4 * 256 * 512)
    monkeypatch.setattr(tiles, "LONGEST_SIDE", 256)
    monkeypatch.setattr("deglint.pipeline.overview.TILE_SIDE", 128)


def coast_of(sea, dtype="uint16"):
    """Sea with land in a corner, a boat, clouds' edge and holes."""
    raw = sea(500, 420, dtype=dtype)
    land = np.array([300, 500, 600, 3000])[:, None, None]
    raw[:, :90, :130] = land * np.random.default_rng(5).normal(1, 0.1, (4, 90, 130))
    raw[:, 300:303, 200:206] = 4000
    raw[:, 450:, 60:90] = 0
    return raw


def outputs_of(source, folder, recipe, read, threads=2):
    folder.mkdir()
    flags, amount = folder / "f.tif", folder / "a.tif"
    result = remove_glint(source, folder / "o.tif", recipe, threads=threads, flags=flags, amount=amount)
    return result, [read(folder / name) for name in ("o.tif", "f.tif", "a.tif")]


RECIPES = {
    "auto": Recipe(),
    "joyce": Recipe(method="joyce"),
    "hedley detrended": Recipe(method="hedley", regression="detrended", sample="40,120,300,333", floor_percentile=2.0),
    "lyzenga": Recipe(method="lyzenga", sample="13,111,400,380", mask="none"),
    "theil-sen": Recipe(method="hedley", regression="theil-sen", sample="150,150,60,90", mask="none"),
    "huber": Recipe(method="lyzenga", regression="huber", sample="150,150,60,90", mask="none"),
}


def threads_of_libraries():
    return [cv2.getNumThreads(), *(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")]


def test_libraries_have_one_thread_each_while_a_fit_runs(sea, write, tmp_path):
    seen, before = [], threads_of_libraries()
    with threadpool_limits(2, user_api="blas"):
        scene = library.open_scene(write(tmp_path / "in.tif", coast_of(sea), nodata=0))
        library.fit_scene(scene, threads=2, progress=lambda *_: seen.append(threads_of_libraries()))
        assert set(threads_of_libraries()[1:]) == {2}
    assert seen
    assert all(set(counts) == {1} for counts in seen)
    assert threads_of_libraries() == before


def test_libraries_get_their_threads_back_when_the_last_of_several_jobs_ends():
    with threadpool_limits(2, user_api="blas"):
        before, (first, second) = threads_of_libraries(), (tiles.one_thread_each() for _ in range(2))
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert set(threads_of_libraries()) == {1}
        second.__exit__(None, None, None)
        assert threads_of_libraries() == before


@pytest.mark.slow
@pytest.mark.parametrize("recipe", list(RECIPES.values())[:4], ids=list(RECIPES)[:4])
def test_the_whole_job_does_not_depend_on_how_pixels_are_stored(sea, write, read, tmp_path, small_tiles, recipe):
    raw = coast_of(sea)
    first, expected = None, None
    names = list(STORED) if recipe.regression == "detrended" else ["strips", "odd tiles", "wide tiles", "deflate"]
    for name in names:
        layout = STORED[name]
        nodata = {} if layout.get("driver") == "ENVI" else {"nodata": 0}
        if not nodata and recipe.mask == "auto":
            continue  # this format has no tag for nodata, so the job is another
        source = write(tmp_path / f"{name}.img", raw, **layout, nodata=0)
        result, found = outputs_of(source, tmp_path / name, recipe, read)
        if first is None:
            first, expected = result, found
            assert result.counts.corrected > 100_000
            continue
        assert result.fitted.model == first.fitted.model, name
        assert result.sidecar["pixels"] == first.sidecar["pixels"], name
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_array_equal(one, other, err_msg=name)


@pytest.mark.parametrize("recipe", RECIPES.values(), ids=RECIPES.keys())
def test_tiles_are_the_whole_image(sea, write, read, tmp_path, monkeypatch, recipe):
    source = write(tmp_path / "in.tif", coast_of(sea), nodata=0)
    whole, expected = outputs_of(source, tmp_path / "whole", recipe, read)
    monkeypatch.setattr(tiles, "tile_shape", lambda *_: (64, 192))
    tiled, found = outputs_of(source, tmp_path / "tiles", recipe, read)
    assert tiled.fitted.model == whole.fitted.model
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("recipe", RECIPES.values(), ids=RECIPES.keys())
def test_threads_are_one_thread(sea, write, read, tmp_path, small_tiles, recipe):
    source = write(tmp_path / "in.tif", coast_of(sea), nodata=0)
    one, expected = outputs_of(source, tmp_path / "1", recipe, read, threads=1)
    many, found = outputs_of(source, tmp_path / "5", recipe, read, threads=5)
    assert many.fitted.model == one.fitted.model
    assert (tmp_path / "1" / "o.tif").read_bytes() == (tmp_path / "5" / "o.tif").read_bytes()
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)


def eight_bands(dtype):
    """Narrow bands, so that every method of the table finds what it needs."""
    rng = np.random.default_rng(3)
    glint = rng.gamma(0.5, 100.0, (70, 150))
    slopes = np.array([1.1, 1.0, 0.9, 0.5, 0.3, 0.5, 0.6, 1.0])[:, None, None]
    water = np.array([900.0, 700, 400, 100, 100, 100, 100, 80])[:, None, None]
    return (water + slopes * glint + rng.normal(0, 2, (8, 70, 150))).astype(dtype)


@pytest.mark.slow
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("method", METHODS)
def test_files_and_arrays_give_the_same_bits(write, read, tmp_path, small_tiles, monkeypatch, method, dtype):
    monkeypatch.setattr("deglint.pipeline.overview.TILE_SIDE", 512)  # an array is one training tile
    raw = eight_bands(dtype)
    source = write(tmp_path / "in.tif", raw, names=[f"L{w}" for w in NARROW], band_tags=at_wavelengths(*NARROW))
    regressions = REGRESSIONS if "regression" in METHODS[method].options else ["auto"]
    for regression in regressions:
        recipe = Recipe(
            method=method, sample="all", mask="none", regression=regression, nir=("8",), bands=("1", "2", "3")
        )
        result = remove_glint(source, tmp_path / "out.tif", recipe, overwrite=True)
        options = {} if regression == "auto" else {"regression": regression}
        scene = library.open_scene(source)
        model = library.fit(method, scene.read(), nir=7, bands=scene.bands, correct=(0, 1, 2), **options)
        assert result.fitted.model == model
        np.testing.assert_array_equal(read(tmp_path / "out.tif"), library.apply(scene.read(), model))
        scene.source.close()


@pytest.mark.parametrize("layout", ["rows", "deflate", "pixel"])
def test_compressed_outputs_hold_no_dead_blocks(sea, write, tmp_path, monkeypatch, layout):
    # a wide scene whose tiles are 64 rows high: blocks of 512 rows would be written, and compressed, eight times
    monkeypatch.setattr(tiles, "SAMPLES", 4 * 64 * 1000)
    raw = sea(700, 1500)
    source = write(tmp_path / "in.tif", raw, **STORED[layout])
    remove_glint(source, tmp_path / "out.tif", Recipe(method="hedley", sample="all", mask="none"),
                 options={"COMPRESS": "DEFLATE", "OVERVIEWS": "NONE"})  # fmt: skip
    with rasterio.open(tmp_path / "out.tif") as dataset:
        used = 0
        rows, columns = dataset.block_shapes[0]
        for band in dataset.indexes if dataset.profile["interleave"] == "band" else [1]:
            for y in range(-(-dataset.height // rows)):
                for x in range(-(-dataset.width // columns)):
                    used += int(dataset.get_tag_item(f"BLOCK_SIZE_{x}_{y}", "TIFF", bidx=band))
    assert (tmp_path / "out.tif").stat().st_size < 1.02 * used + 20_000
