"""Further references of the Wiener filter: red-edge bands can be used if they show no signal of the water."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..moments import Mask
from ..scene import FloatArray
from .predict import glint
from .request import FitRequest
from .wiener import SampleTile, fit

FURTHER_FROM = 680.0
"""Shortest wavelength of further references [nm]: from here on water absorbs half of the light within .7 m. Red bands
show objects and plumes: with them as references, a fifth of the objects in simulated scenes lost their contrast."""
TEST_TILES = 4  # tiles on which further references are tested, spread over the sample
EVEN_SIDE = 9  # window of the local means in the test [pixel]: wider than kernels, narrower than bottoms and plumes
SLIGHT = 0.1  # change of local means relative to the standard deviation about them, up to which it does not matter


def more_references(request: FitRequest, tiles: Sequence[SampleTile]) -> tuple[int, ...]:
    """Red-edge bands (0-based) that can be used as further references, as they show no signal of the water.

    Red-edge bands are closer to the shorter bands in wavelength, noise and time than the NIR. But if they show bottom,
    plumes or algae, these would be subtracted from the shorter bands. So the glint is removed with and without red
    edge. What red edge removes of the variance about local means is glint and noise; what it changes in the local means
    may be signal. If it changes more than it removes, and more than `SLIGHT`, this is repeated without the shortest.
    """
    return longest_that(request, lambda more: _removes_more(request, tiles, more))


def longest_that(request: FitRequest, serve: Callable[[tuple[int, ...]], bool]) -> tuple[int, ...]:
    """Bands to correct from `FURTHER_FROM` nm on (0-based). While `serve(bands)` is False, the shortest is dropped."""
    waves = {b: request.bands[b].wavelength or 0.0 for b in request.correct}
    more = sorted((b for b, w in waves.items() if w >= FURTHER_FROM), key=waves.__getitem__)
    while more and not serve(tuple(more)):
        more.pop(0)
    return tuple(more)


def _removes_more(request: FitRequest, tiles: Sequence[SampleTile], more: tuple[int, ...]) -> bool:
    """Whether the references `more` (0-based bands) remove more variance about local means than they change in these.

    A change up to `SLIGHT` is no harm. Both are variances over the half of the pixels with less glint, relative to the
    variance about local means without `more`, averaged over bands. False if nothing could be tested, or if all
    corrected bands are references.
    """
    tiles = tiles[:: max(len(tiles) // TEST_TILES, 1)]
    plain, longer = (fit(replace(request, more=m, level_error=False), tiles) for m in (request.more, more))
    shorter = [f.band for f in longer.fits if f.band not in more]
    parts: list[FloatArray] = []  # (band, part, pixel) of each tile; the parts are those of `_parts`
    for tile in tiles if plain.fits and shorter else ():
        inside = tile.sample & np.isfinite(tile.block).all(axis=0)
        if inside.any():
            before, after = (glint(tile.block, m, tile.water, tile.origin)[0] for m in (plain, longer))
            strength = np.sum([before[b] for b in shorter], axis=0)
            calm = inside & (strength <= np.median(strength[inside]))
            bands = (_parts(tile.block[b] - before[b], before[b] - after[b], inside) for b in shorter)
            parts.append(np.stack([b[:, calm] for b in bands]))
    if not parts:
        return False
    fine, left, moved = np.concatenate(parts, axis=-1).var(axis=-1).T
    fine = np.maximum(fine, np.finfo(np.float64).tiny)
    return bool(np.mean(moved / fine) <= max(np.mean(1 - left / fine), SLIGHT**2))


def _parts(result: FloatArray, change: FloatArray, inside: Mask) -> FloatArray:
    """Parts of the `result` of a removal in a band and of its `change`, both (row, column); (3, row, column).

    The parts are the deviation of the result from its local means over `inside`, the same after the change, and the
    local means of the change.
    """
    import cv2

    share = np.maximum(cv2.blur(inside.astype(np.float64), (EVEN_SIDE, EVEN_SIDE)), 1 / EVEN_SIDE**2)
    own, moved = (cv2.blur(np.where(inside, a, 0), (EVEN_SIDE, EVEN_SIDE)) / share for a in (result, change))
    return np.stack([result - own, result - own + change - moved, moved])
