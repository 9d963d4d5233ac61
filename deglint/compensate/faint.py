"""What little an opening takes where the NIR shows no glint: half of it is given back.

An opening replaces whatever stands more than a spread or two above the level of the water. Where flashes of other
instants may be anywhere, it does so where the NIR shows none, too, and most of what it replaces there is no glint: it
is the upper tail of noise, or crests that mirror a brighter sky, which are the water's own. Of such a pixel, x above
the level, the truth is near 0 if it is noise, and nearer to x if it is a crest. Halfway is nearer to it than x, unless
it is above 3/4 x; and nearer than 0, unless it is below 1/4 x. A flash is stronger, or lies beside what is stronger:
there nothing is given back. On bright things an opening sinks further, and takes more for it: what counts as strong
grows with the level as the threshold of the opening does (`deglint.compensate.identify`).

Assumes that faint flashes are rare where the NIR shows none: half of these stays. Fails for the widest skirts of
flashes that the optics blur over several pixels: half a spread or two of them stays. Costs 1.4 ns for each band of each
pixel of a tile that has parts without glint (`python -m benchmarks stages`)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..scene import FloatArray
from .noise import Spread
from .presence import Share

FAINT = 5.0
"""How many standard deviations of pixels without glint above its new value a replaced one may have lain, at most."""
SKIRT = 2
"""Pixels around a stronger one that may be its skirt."""


def give_back(
    image: FloatArray,
    own: FloatArray,
    replaced: npt.NDArray[np.bool_],
    share: Share,
    spreads: Sequence[Spread],
    within: tuple[slice, slice],
    out: FloatArray,
) -> None:
    """Give back half of what was taken from faint pixels, with nothing strong beside them, where there is no glint.

    Parameters
    ----------
    image, own : (band, row, column) ndarray
        A block as an opening leaves it, with `SKIRT` more pixels on every side where the scene has them, and as it was.
    replaced : (band, row, column) bool ndarray
        Where it was changed; of the same block.
    share : (row, column) float32 ndarray
        Of the block's inner part: how much glint there is; see `deglint.compensate.presence`.
    spreads : sequence of Spread
        Of the bands that are opened.
    within : (slice, slice)
        Where that part lies in the block.
    out : (band, row, column) ndarray
        Of that part, what is written to; may be that part of the image itself.

    Examples
    --------
    >>> image, own = np.zeros((1, 1, 9), np.float32), np.zeros((1, 1, 9), np.float32)
    >>> own[0, 0, [1, 5, 6]] = 2, 9, 2
    >>> share, inner = np.zeros((1, 9), np.float32), (slice(0, 1), slice(0, 9))
    >>> give_back(image, own, own > 0, share, [Spread(0, 1.0)], inner, image)
    >>> image[0, 0].tolist()
    [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    from ._presence_kernels import halve
    from .glance import block

    bands, limits = np.array([s.band for s in spreads], np.int64), np.empty((len(spreads), 5), np.float32)
    for limit, (_, sigma, *growth) in zip(limits, spreads, strict=True):
        limit[:] = FAINT * sigma, *growth
    for band in sorted(set(range(len(image))) - set(bands.tolist())):
        out[band] = image[band][within]
    seen = block(image), block(own), block(replaced)
    corner = tuple(s.start for s in within)
    halve(*seen, share == 0, image.shape[1:], corner, bands, limits, SKIRT, block(out, written=True))
