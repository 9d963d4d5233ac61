"""Images put together from parts: the same pixels, masks and properties as written in one go."""

import numpy as np
import pytest
import rasterio
from rio_cogeo import cog_validate

from deglint import open_scene
from deglint.errors import WriteError
from deglint.pipeline.overview import raster_of
from deglint.raster.environment import environment
from deglint.raster.output import Layout, write_part, writing, writing_parts
from deglint.raster.scratch import Scratch
from deglint.tiles import tiles

TILE = (128, 192)


def both_ways(folder, layout, data, valid):
    """Written in one go to a.tif, put together in b.tif."""
    parts = folder / "parts"
    parts.mkdir()
    with (
        environment(),
        Scratch() as scratch,
        writing(scratch, folder / "a.tif", layout) as one,
        writing_parts(scratch, folder / "b.tif", layout) as other,
    ):
        for i, tile in enumerate(tiles(layout.info.height, layout.info.width, layout.tile)):
            at = np.s_[tile.row0 : tile.row1, tile.col0 : tile.col1]
            block, known = data[(slice(None), *at)], valid[at] if layout.masked else None
            one.write(block, tile.window)
            if known is not None:
                one.write_mask(known, tile.window)
            other.write(write_part(parts / str(i), block, known), tile.window)


@pytest.mark.parametrize("masked", [False, True], ids=["plain", "masked"])
@pytest.mark.parametrize("interleave", ["band", "pixel"])
@pytest.mark.parametrize(
    ("compress", "options"),
    [("none", {}), ("deflate", {"BIGTIFF": "YES"}), ("zstd", {"ZSTD_LEVEL": "1"}), ("lzw", {"NUM_THREADS": "2"}),
     ("deflate", {"COMPRESS": "LERC_ZSTD"})],
    ids=["none", "deflate in BigTIFF", "zstd", "lzw", "lerc"],
)  # fmt: skip
def test_parts_are_the_image(sea, write, tmp_path, compress, interleave, options, masked):
    shape = {"tiled": True, "blockxsize": 64, "blockysize": 64, "interleave": interleave, "compress": compress}
    source = write(tmp_path / "in.tif", sea(500, 450), nodata=0, **shape)
    info = raster_of(open_scene(source)).info
    layout = Layout(info, (0, 1, 2, 3), "uint16", 0, options, masked=masked, tile=TILE)
    with rasterio.open(source) as dataset:
        data = dataset.read()
    valid = np.random.default_rng(0).random(data.shape[1:]) < 0.5
    both_ways(tmp_path, layout, data, valid)
    with rasterio.open(tmp_path / "a.tif") as a, rasterio.open(tmp_path / "b.tif") as b:
        np.testing.assert_array_equal(b.read(), data)
        np.testing.assert_array_equal(b.read_masks(), a.read_masks())
        assert b.profile == a.profile
        assert (b.tags(), b.descriptions) == (a.tags(), a.descriptions)
        assert [b.tags(i) for i in b.indexes] == [a.tags(i) for i in a.indexes]
    good, errors, _warnings = cog_validate(str(tmp_path / "b.tif"), quiet=True)
    assert good, errors


def test_a_part_that_is_not_there_is_one_line_and_leaves_nothing(sea, write, tmp_path):
    info = raster_of(open_scene(write(tmp_path / "in.tif", sea(200, 200)))).info
    layout = Layout(info, (0,), "uint16", tile=TILE)
    part = write_part(tmp_path / "p", np.zeros((1, 128, 192), np.uint16), None)
    part.unlink()
    with (
        pytest.raises(WriteError, match="need the same file system"),
        Scratch() as scratch,
        writing_parts(scratch, tmp_path / "out.tif", layout) as out,
    ):
        out.write(part, ((0, 128), (0, 192)))
    assert [p.name for p in tmp_path.iterdir()] == ["in.tif"]
