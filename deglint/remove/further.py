"""Further references of the Wiener filter: red-edge bands can be used if they show no signal of the water."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..scene import FloatArray
from .noise import noise
from .predict import glint
from .request import FitRequest
from .wiener import SampleTile, fit

FURTHER_FROM = 680.0
"""Shortest wavelength of further references [nm]: from here on water absorbs half of the light within .7 m. Red bands
show objects and plumes: with them as references, a fifth of the objects in simulated scenes lost their contrast."""
TEST_TILES = 4  # tiles on which further references are tested, spread over the sample
EVEN_SIDE, MOST_TAKEN = 9, 2.0
"""`EVEN_SIDE`: window over which the change by more references is averaged [pixel]. `MOST_TAKEN`: upper limit of the
standard deviation of these means over the noise of a pixel, which a bottom seen by red edge exceeds several times."""


def more_references(request: FitRequest, tiles: Sequence[SampleTile]) -> tuple[int, ...]:
    """Red-edge bands (0-based) that can be used as further references, as they show no signal of the water.

    Red-edge bands are closer to the shorter bands in wavelength, noise and time than the NIR. But if they show bottom,
    plumes or algae, these would be subtracted from the shorter bands. So the glint is removed with and without red
    edge. If the mean difference of `EVEN_SIDE` x `EVEN_SIDE` pixels, in the half of the pixels with less glint, has in
    any band a standard deviation above `MOST_TAKEN` times the noise, this is repeated without the shortest red edge.
    """
    return longest_that(request, lambda more: _taken_from_water(request, tiles, more) <= MOST_TAKEN)


def longest_that(request: FitRequest, serve: Callable[[tuple[int, ...]], bool]) -> tuple[int, ...]:
    """Bands to correct from `FURTHER_FROM` nm on (0-based). While `serve(bands)` is False, the shortest is dropped."""
    waves = {b: request.bands[b].wavelength or 0.0 for b in request.correct}
    more = sorted((b for b, w in waves.items() if w >= FURTHER_FROM), key=waves.__getitem__)
    while more and not serve(tuple(more)):
        more.pop(0)
    return tuple(more)


def _taken_from_water(request: FitRequest, tiles: Sequence[SampleTile], more: tuple[int, ...]) -> float:
    """How much the references `more` (0-based bands) change the removal over water with weak glint.

    The result is the standard deviation of the averaged change divided by the noise, in the band where this ratio is
    largest. It is infinite if nothing could be tested, or if all corrected bands are references.
    """
    import cv2

    tiles = tiles[:: max(len(tiles) // TEST_TILES, 1)]
    plain, longer = (fit(replace(request, more=m, level_error=False), tiles) for m in (request.more, more))
    shorter = [f.band for f in longer.fits if f.band not in more]
    if not plain.fits or not shorter:
        return np.inf
    changes: list[list[FloatArray]] = [[] for _ in shorter]
    for tile in tiles:
        inside = tile.sample & np.isfinite(tile.block).all(axis=0)
        if not inside.any():
            continue
        before, _ = glint(tile.block, plain, tile.water, tile.origin)
        after, _ = glint(tile.block, longer, tile.water, tile.origin)
        strength = np.sum([before[b] for b in shorter], axis=0)
        calm = inside & (strength <= np.median(strength[inside]))
        for k, b in enumerate(shorter):
            sigma = noise([np.where(inside, tile.block[b], 0).astype(np.float32)], (inside,))
            change = cv2.blur(np.where(inside, after[b] - before[b], 0), (EVEN_SIDE, EVEN_SIDE))
            changes[k].append(change[calm] / sigma)
    return max((float(np.std(np.concatenate(c))) for c in changes if c), default=np.inf)
