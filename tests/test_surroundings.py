"""Masks that look beyond a tile: the same to the bit as over the whole scene, whatever the tiles and threads."""

import numpy as np
import pytest

from deglint import tiles as tiling
from deglint.masks import Roles, fit_water, opened, valid_for, water
from deglint.pipeline.surroundings import Surroundings
from deglint.scene import Band, Scene


class Arrays:
    """A source that serves an array and counts what is read."""

    def __init__(self, block):
        self.block, self.read_pixels = block, 0

    def read(self, window, bands):
        self.read_pixels += (window[0][1] - window[0][0]) * (window[1][1] - window[1][0])
        return self.block[list(bands), slice(*window[0]), slice(*window[1])].copy()


def sparkling_coast(shape=(300, 330)):
    """Water under sparkle, an island across tile borders, some missing pixels."""
    rng = np.random.default_rng(3)
    glint = np.where(rng.random(shape) < 0.3, rng.gamma(1.0, 0.2, shape), 0.0)
    block = np.stack([0.05 + glint, 0.01 + glint]) + rng.normal(0, 0.001, (2, *shape))
    block[:, 100:170, 110:230] = np.array([0.12, 0.9])[:, None, None]
    block[:, 120:140, 40:60] = np.nan
    return block.astype(np.float32)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("side", [(64, 64), (128, 64), (64, 330), (300, 330)])
def test_tiles_see_what_the_whole_scene_sees(side, threads):
    block = sparkling_coast()
    rule = fit_water([block], Roles(nir=1, green=0))
    assert rule.halo > 0
    whole = water(block, rule)
    assert 0.05 < (~whole).mean() < 0.2
    source = Arrays(block)
    scene = Scene((Band("G"), Band("N")), *block.shape[1:], source)
    everything = tiling.tiles(*block.shape[1:], side)
    around = Surroundings(scene, rule, 1, everything)

    def work(tile):
        core = block[:, slice(*tile.window[0]), slice(*tile.window[1])]
        inside = valid_for(core, rule.roles)
        masks = around.around(tile, core[1])
        if masks is None:
            return inside
        outer = tile.grown(rule.halo, *block.shape[1:])
        top, bottom, left, right = tile.crop_of(outer)
        found = opened(*masks, rule.window)
        return inside & ~found[top : found.shape[0] - bottom, left : found.shape[1] - right]

    for tile, mask in tiling.run(everything, work, threads=threads):
        np.testing.assert_array_equal(mask, whole[slice(*tile.window[0]), slice(*tile.window[1])])
    assert source.read_pixels <= block[0].size  # nothing is read ahead more than once


def test_a_tile_without_bright_pixels_reads_nothing():
    block = sparkling_coast()
    rule = fit_water([block], Roles(nir=1, green=0))
    source = Arrays(np.full_like(block, 0.01))
    scene = Scene((Band("G"), Band("N")), *block.shape[1:], source)
    everything = tiling.tiles(*block.shape[1:], (64, 64))
    around = Surroundings(scene, rule, 1, everything)
    for tile in everything:
        assert around.around(tile, np.full(tile.shape, 0.01, np.float32)) is None
    assert source.read_pixels == 0


def test_an_error_while_reading_ahead_reaches_whoever_waits():
    class Broken(Arrays):
        def read(self, window, bands):
            raise OSError("damaged")

    block = sparkling_coast()
    rule = fit_water([block], Roles(nir=1, green=0))
    scene = Scene((Band("G"), Band("N")), *block.shape[1:], Broken(block))
    everything = tiling.tiles(*block.shape[1:], (64, 64))
    around = Surroundings(scene, rule, 1, everything)
    with pytest.raises(OSError, match="damaged"):
        around.around(everything[0], block[1, :64, :64])
