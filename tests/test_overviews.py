"""Overviews and flag rasters: valid cloud-optimised files, means that leave nodata out, codes that are not averaged."""

from xml.etree import ElementTree as ET

import numpy as np
import pytest
import rasterio
from rio_cogeo import cog_validate

from deglint import Recipe, open_scene, remove_glint
from deglint.pipeline.flags import GLINT_CLASSES
from deglint.pipeline.overview import raster_of
from deglint.raster.environment import environment
from deglint.raster.output import Layout, RasterWriter, Scratch, levels
from deglint.tiles import tiles

SIZE = 1100, 1030


def write(folder, data, layout, valid=None):
    """Write an image tile by tile; its name."""
    with (
        environment(),
        Scratch() as scratch,
        RasterWriter(scratch.add(folder / "out.tif"), folder / "out.tif", layout) as writer,
    ):
        for tile in tiles(*SIZE, layout.tile):
            at = np.s_[:, tile.row0 : tile.row1, tile.col0 : tile.col1]
            writer.write(data[at], tile.window)
            if valid is not None:
                writer.write_mask(valid[at[1:]], tile.window)
    assert [p.name for p in folder.iterdir() if p.name != "in.tif"] == ["out.tif"]
    return folder / "out.tif"


@pytest.fixture
def info(sea, tmp_path, write):
    source = write(tmp_path / "in.tif", sea(*SIZE)[:, :16, :16])
    found = raster_of(open_scene(source)).info
    return lambda **more: type(found)(**(vars(found) | {"height": SIZE[0], "width": SIZE[1]} | more))


@pytest.mark.slow
@pytest.mark.parametrize("masked", [False, True], ids=["nodata", "masked"])
@pytest.mark.parametrize(("compression", "interleave"), [(None, "band"), ("deflate", "pixel"), ("zstd", "band")])
def test_overviews_are_means_of_what_is_valid(info, tmp_path, masked, compression, interleave):
    data = np.random.default_rng(0).integers(100, 999, (4, *SIZE)).astype("uint16")
    valid = np.ones(SIZE, np.bool_)
    valid[:300, 1:500:2] = False
    data[:, ~valid] = 60000 if masked else 0
    layout = Layout(info(compression=compression, interleave=interleave), (0, 1, 2, 3), "uint16",
                    None if masked else 0, masked=masked)  # fmt: skip
    out = write(tmp_path, data, layout, valid if masked else None)
    good, errors, warnings = cog_validate(str(out), quiet=True)
    assert (good, errors, warnings) == (True, [], [])
    with rasterio.open(out) as dataset:
        np.testing.assert_array_equal(dataset.read(), data)
        assert dataset.overviews(1) == [2, 4]
        assert dataset.profile.get("compress") == compression
        half = dataset.read(1, out_shape=(SIZE[0] // 2, SIZE[1] // 2))
    quads = np.where(valid, data[0], np.nan).reshape(SIZE[0] // 2, 2, SIZE[1] // 2, 2)
    np.testing.assert_allclose(half, np.nanmean(quads, axis=(1, 3)), atol=0.51)


def test_flags_have_colours_and_meanings_in_the_file_and_are_not_averaged(info, tmp_path):
    data = np.random.default_rng(0).choice(np.array([4, 132], np.uint8), (1, *SIZE))
    out = write(tmp_path, data, Layout(info(), (0,), "uint8", scaled=False, flags={4: "corrected", 128: "protected"}))
    assert cog_validate(str(out), quiet=True)[0]
    with rasterio.open(out) as dataset:
        assert set(np.unique(dataset.read(1, out_shape=(550, 515)))) == {4, 132}
        assert dataset.colorinterp[0].name == "palette"
        colours = dataset.colormap(1)
        assert colours[4] != colours[132] == colours[128]
        assert {k: v for k, v in dataset.tags(1).items() if k.startswith("FLAG")} == {
            "FLAG_4": "corrected",
            "FLAG_128": "protected",
        }


def test_overviews_can_be_left_out_and_small_images_have_none(info, tmp_path):
    layout = Layout(info(), (0,), "uint16", options={"overviews": "none"})
    with rasterio.open(write(tmp_path, np.ones((1, *SIZE), np.uint16), layout)) as dataset:
        assert dataset.overviews(1) == []
    assert (levels(1023, 1), levels(1024, 1), levels(5, 5000)) == ([], [2], [2, 4, 8, 16])


@pytest.mark.parametrize("dtype", ["int64", "uint64"])
def test_integers_of_64_bits_with_nodata_get_all_overviews(sea, write, tmp_path, dtype):
    raw = sea(48, 1100).astype(dtype)
    raw[:, :5, :9] = 7
    recipe = Recipe(method="hedley", sample="all", mask="none")
    remove_glint(write(tmp_path / "in.tif", raw, nodata=7), tmp_path / "out.tif", recipe)
    with rasterio.open(tmp_path / "out.tif") as dataset:
        assert (dataset.dtypes[0], dataset.overviews(1)) == (dtype, [2, 4])


@pytest.mark.parametrize("program", ["deglint", "rxdetect"])
def test_flag_rasters_of_both_programs_have_colours(request, sea, write, tmp_path, program):
    source, flags = write(tmp_path / "in.tif", sea()), tmp_path / "flags.tif"
    call = ["remove", "--method", "hedley"] if program == "deglint" else ["score", "--method", "rx"]
    assert request.getfixturevalue(program)(*call, source, tmp_path / "out.tif", "--flags", flags).code == 0
    with rasterio.open(flags) as dataset:
        assert dataset.colorinterp[0].name == "palette"
        meanings = {int(k[5:]): v for k, v in dataset.tags(1).items() if k.startswith("FLAG_")}
    (beside,) = tmp_path.glob("*.aux.xml")
    bands = [[c.text for c in band.iter("Category")] for band in ET.parse(beside).iter("PAMRasterBand")]
    assert len(bands[0]) == 256
    assert bands[0][0] == "no flag"
    assert all(meaning.startswith(bands[0][bit]) for bit, meaning in meanings.items())
    first, second = list(meanings)[:2]
    assert bands[0][first | second] in (f"{bands[0][a]}; {bands[0][b]}" for a, b in ((first, second), (second, first)))
    if program == "deglint":
        assert bands[1] == list(GLINT_CLASSES.values())
