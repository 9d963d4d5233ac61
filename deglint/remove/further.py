"""Further references of the Wiener filter: red-edge bands can be used if they show no signal of the water."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..moments import Mask
from ..scene import FloatArray
from .detrend import detrend
from .noise import noise
from .predict import predictions
from .request import FitRequest
from .wiener import Prepared, SampleTile, fit_without_levels, prepare

FURTHER_FROM = 680.0
"""Shortest wavelength of further references [nm]: from here on water absorbs half of the light within .7 m. Red bands
show objects and plumes: with them as references, a fifth of the objects in simulated scenes lost their contrast."""
TEST_TILES = 4  # tiles on which further references are tested, spread over the sample
EVEN_SIDE = 9  # window of the local means in the test [pixel]: wider than kernels, narrower than reefs and plumes
MOST_MOVED = 2.0
"""Upper limit of the change of local means by further references: standard deviation over the pixels, relative to the
noise of a pixel. Where red edge shows a plume or the bottom, the change is several times larger."""


def more_references(request: FitRequest, tiles: Sequence[SampleTile]) -> tuple[int, ...]:
    """Red-edge bands (0-based) that can be used as further references, as they show no signal of the water.

    Red-edge bands are nearer to the shorter bands in wavelength, noise and time than the NIR is. But if they show the
    bottom, plumes or algae, these signals would be subtracted from the shorter bands. So glint is removed with and
    without red-edge bands, as a test. The additional reduction of the variance about local means is glint and noise; a
    change of the local means where glint is weak may be signal. If the change exceeds the reduction, or `MOST_MOVED`
    times the noise in any band, the test is repeated without the shortest red-edge band. The result may be empty.
    """
    longest = longest_that(request, lambda _: True)
    if not longest:
        return ()
    ready = prepare(replace(request, more=longest), tiles[:: max(len(tiles) // TEST_TILES, 1)])
    plain = _predicted(ready, ())
    return longest_that(request, lambda more: _harmless(ready, plain, more))


def longest_that(request: FitRequest, serve: Callable[[tuple[int, ...]], bool]) -> tuple[int, ...]:
    """Bands to correct (0-based) from `FURTHER_FROM` nm on; the shortest is dropped until `serve(bands)` is True."""
    waves = {b: request.bands[b].wavelength or 0.0 for b in request.correct}
    more = sorted((b for b, w in waves.items() if w >= FURTHER_FROM), key=waves.__getitem__)
    while more and not serve(tuple(more)):
        more.pop(0)
    return tuple(more)


def _predicted(ready: Prepared, more: tuple[int, ...]) -> list[FloatArray]:
    """Glint plus a constant in each tile, (band, row, column), predicted with further references `more` (0-based).
    The bands are those of `FitRequest.correct`. The list is empty if nothing would be corrected.
    """
    model, _ = fit_without_levels(ready._replace(request=replace(ready.request, more=more)))
    slopes = np.array([f.slope for f in model.fits], np.float32)[:, None, None]
    tiles = ready.tiles if model.fits else []
    return [slopes * np.stack(list(predictions(t.references, model, t.origin))) for t in tiles]


def _harmless(ready: Prepared, plain: list[FloatArray], more: tuple[int, ...]) -> bool:
    """Whether further references `more` (0-based) pass the test of `more_references`. False if the test is impossible,
    or all bands to correct are in `more`. `plain` is the result of `_predicted` without further references.
    The change of local means is measured by its variance over the half of the pixels with less glint. The reduction of
    the variance about local means is computed over the same pixels and over all pixels, and the larger one is taken.
    Change and reduction are divided by the variance about local means without `more`, and summed over bands.
    """
    shorter = [k for k, band in enumerate(ready.request.correct) if band not in more]
    inside, longer = [t.sample for t in ready.tiles], _predicted(ready, more)
    if not plain or not longer or not shorter:
        return False
    parts: list[FloatArray] = []  # (part, band, pixel) of each tile
    less_glint: list[Mask] = []  # (pixel,) of each tile
    for tile, before, after in zip(ready.tiles, plain, longer, strict=True):
        result, change, mask = np.stack(tile.bands) - before, before - after, tile.sample
        strength = before[shorter].sum(axis=0)[mask]
        less_glint.append(strength <= (np.median(strength) if strength.size else 0))
        own, other, rest = (detrend(a[shorter], mask, EVEN_SIDE)[:, mask] for a in (result, result + change, change))
        parts.append(np.stack([own, other, change[shorter][:, mask] - rest]))  # the last: local means of the change
    every = np.concatenate(parts, axis=-1)
    fine, left, _ = every.var(axis=-1)
    fine_of_less, left_of_less, moved = every[..., np.concatenate(less_glint)].var(axis=-1)
    unit = np.maximum(fine, np.finfo(np.float64).tiny)
    removed = max(np.sum((fine - left) / unit), np.sum((fine_of_less - left_of_less) / unit))
    water = [np.where(t.sample, t.bands, 0).astype(np.float32) for t in ready.tiles]
    limit = [(MOST_MOVED * noise([block[k] for block in water], inside)) ** 2 for k in shorter]
    return bool(np.sum(moved / unit) <= removed and (moved <= limit).all())
