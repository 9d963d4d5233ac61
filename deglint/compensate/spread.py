"""How pixels lie about a level: how far those below it spread, and what stands out above.

Glint only adds, so the spread is told from below, s = 1.4826 median(m - x | x <= m). What lies far above is no noise,
but glint, or a thing under water.

References
----------
Rousseeuw, Croux (1993), Journal of the American Statistical Association 88, 1273-1283,
doi:10.1080/01621459.1993.10476408 (median absolute deviation and its lower-side form)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

COVER_K = 3.0
"""Standard deviations above the local level that count as glint when cover is told."""
CERTAIN_K = 5.0
"""The same where noise is to be ruled out: of a normal distribution 3e-7 lie above."""
ALIKE = 2.0
"""How many times as far as in the next band a thing stands out of the noise, at most."""
MOST = 200_000
"""Most pixels of the sample that they are taken from."""


def lower_spread(values: npt.NDArray[np.floating[Any]], middle: float, step: float = 0.0) -> float:
    """Standard deviation from the values below the middle, 1.4826 median(m - x | x <= m).

    Parameters
    ----------
    values : (pixels,) ndarray
    middle : float
        m.
    step : float
        Where values come in whole steps, each is taken to be spread evenly over its step: else the median jumps by
        steps, and the spread of noise of one or two steps comes out anywhere from half to twice what it is. (This
        adds a twelfth of the step squared to the variance.)

    Examples
    --------
    >>> counts = np.rint(np.random.default_rng(0).normal(50.2, 1.2, 100_000))
    >>> round(lower_spread(counts, 50.2), 2), round(lower_spread(counts, 50.2, 1.0), 2)
    (0.3, 1.25)
    """
    return spread_of_sorted(np.sort(values), middle, step)


def spread_of_sorted(ordered: npt.NDArray[np.floating[Any]], middle: float, step: float = 0.0) -> float:
    """`lower_spread` of values in ascending order."""
    if step > 0:
        first = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
        distinct = ordered[first].astype(np.float64)
        total = np.append(first, ordered.size).astype(np.float64)
        edges = np.concatenate([distinct - step / 2, [distinct[-1] + step / 2]])
        half = np.interp(middle, edges, total) / 2
        return 1.4826 * (middle - float(np.interp(half, total, edges)))
    count = int(np.searchsorted(ordered, ordered.dtype.type(middle), side="right"))
    if not count:
        return 0.0
    return 1.4826 * float(np.median(middle - ordered[[(count - 1) // 2, count // 2]]))


def standing_out(
    away: Sequence[npt.NDArray[np.floating[Any]]],
    offsets: Sequence[float],
    sigmas: Sequence[float],
    order: Sequence[int],
    nir: int,
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """What glint, and what other bright things, add to the variance of each band.

    Counted is what no noise makes, more than `CERTAIN_K` standard deviations above the level. A thing under water
    stands out in the next band by wavelength too, by `COVER_K` at least and as much as its noise over `ALIKE`, and not
    in the NIR. Glint stands out in the NIR as well where bands see the sea at one instant, and where they do not in
    one band alone, but for chance: of independent bands, each with a share c of glint, at most a share
    (1 - c) (1 - (1 - c)^2) < 0.4 passes for things.

    Parameters
    ----------
    away : sequence of (pixels,) ndarray
        Pixels less their opened level, band by band, the same pixels in each.
    offsets, sigmas : sequence of float
        Distance of the commonest pixel from the level, and standard deviation about that.
    order : sequence of int
        Bands by wavelength.
    nir : int
        0-based.

    Returns
    -------
    glint, things : tuple of float
        Mean square of what stands out, in variances of pixels without glint.
    """
    step = max(away[0].size // MOST, 1)
    z = [(a[::step].astype(np.float64) - o) / s for a, o, s in zip(away, offsets, sigmas, strict=True)]
    dark = ~(z[nir] > CERTAIN_K)
    glint, things = [0.0] * len(z), [0.0] * len(z)
    for i, band in enumerate(order):
        beside = np.full(z[band].shape, -np.inf)
        for other in (*order[max(i - 1, 0) : i], *order[i + 1 : i + 2]):
            beside = np.fmax(beside, z[other])
        own, sure = z[band], z[band] > CERTAIN_K
        like = np.minimum(own, ALIKE * beside)[sure & dark & (beside > COVER_K)]
        count = max(int(np.isfinite(own).sum()), 1)
        things[band] = float(like @ like) / count
        glint[band] = float(own[sure] @ own[sure]) / count - things[band]
    return tuple(glint), tuple(things)
