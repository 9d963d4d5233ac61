"""Small bright things that a compensation would erase: found by being there at every instant, and put back.

An opening takes away whatever is smaller than its element: sparkle, and boats and swimmers with it. Where the bands
look at different instants there is a difference: sparkle is drawn anew for each band, a thing is in all of them, with
the spectrum of a thing. `deglint.compensate.evidence` weighs the two for each pixel; sparkle that lasts counts against,
by as much as the scene's own sparkle lasts. Neighbours must agree: the evidence summed over 3 x 3 pixels is what is
compared with a threshold, which rises where sparkle often looks like things.

`fit` learns from parts of a scene, `things` looks at a tile, `put_back` gives things back to the compensated bands.
Where all bands look at once sparkle is in all of them too, and there is no test: see `deglint.remove.reference`.
Never here: files, tiles, the level itself (an opening makes it).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import FitError, InputError
from ..scene import Band, FloatArray
from .evidence import (
    LEAST_SCORE,
    REACH,
    BoolArray,
    Float64,
    Protection,
    binned,
    clusters,
    counted,
    grown,
    plain,
    score,
    tables,
)
from .lasting import MOST_LASTING, lasting, steady
from .shapes import shapes
from .things import Things, lifted, put, put_back, things

__all__ = ["Protection", "Things", "daylight", "fit", "instants", "lifted", "put", "put_back", "things"]

Look = tuple[FloatArray, FloatArray]
Pair = tuple[FloatArray, FloatArray]
Each = Callable[..., Iterable[Any]]

LONGEST = 1100.0
"""Bands beyond this are left out [nm]: things are dark there in ways that the shapes do not know."""
MOST_BANDS = 16
INSTANTS, LEAST_DELAY = 4, 0.005
"""Different instants that the test needs; bands nearer than this in time are one [s]."""
WIDTH = 40.0
"""Width of a band where it is not known [nm]."""
USUAL_SUM = 25.0
"""Threshold on the 3 x 3 sum of S."""
USUAL_RATE, SUM_RISES = 1e-3, 14.0
"""Share of pixels of sparkle above `LEAST_SCORE` up to which it holds, and its rise where they are e times as many."""
USUAL_AROUND = 0.9
"""Share of squares of sparkle whose power may be around a thing."""
MOST_THINGS = 0.05
"""Where more pixels than this share would be things the bands see the same sparkle, whatever their times are."""
BRIGHTEST = 0.9999
"""Share of pixels that are darker than white in every band, where the light is measured by the glint."""


def instants(bands: Sequence[Band]) -> tuple[tuple[int, ...], str]:
    """Bands that can be judged, in the order of time, and why not, if they cannot.

    Examples
    --------
    >>> instants([Band("B02"), Band("B03")])[1]
    'wavelengths and time offsets of at least 4 bands must be known, got 0'
    """
    times = {i: b.time_offset for i, b in enumerate(bands) if b.wavelength and b.wavelength < LONGEST}
    known = {i: t for i, t in times.items() if t is not None}
    if len(known) < INSTANTS:
        return (), f"wavelengths and time offsets of at least {INSTANTS} bands must be known, got {len(known)}"
    if len(known) > MOST_BANDS:
        return (), f"at most {MOST_BANDS} bands can be judged, got {len(known)}"
    order = sorted(known, key=lambda i: (known[i], i))
    several = 1 + int((np.diff([known[i] for i in order]) >= LEAST_DELAY).sum())
    if several < INSTANTS:
        return (), f"the bands look at {several} different instants, but the test needs {INSTANTS}"
    return tuple(order), ""


def daylight(bands: Sequence[Band], sun_zenith: float) -> Float64:
    """Radiance of a white matt thing, level on the sea, ``(E_direct + E_diffuse) / pi`` [W m-2 sr-1 nm-1].

    For `fit` where the scene is in radiance; see `deglint.physics.atmosphere.irradiance` for the model.

    Parameters
    ----------
    bands : sequence of Band
        With wavelengths; 1 is given where they are not known or beyond 1000 nm.
    sun_zenith : float
        [deg]

    Returns
    -------
    (band,) ndarray
    """
    from ..physics.atmosphere import Air, irradiance

    out = np.ones(len(bands))
    for i, band in enumerate(bands):
        if band.wavelength and 300.0 <= band.wavelength <= 1000.0:
            half = (band.width or WIDTH) / 2
            inside = np.clip(np.linspace(band.wavelength - half, band.wavelength + half, 65), 300.0, 1000.0)
            out[i] = np.sum(irradiance(inside, sun_zenith, Air()), axis=0).mean() / np.pi
    return out


def fit(
    looks: Sequence[Look],
    bands: Sequence[Band],
    *,
    noise: npt.ArrayLike,
    irradiance: npt.ArrayLike | None = None,
    each: Callable[..., Iterable[Any]] = map,
) -> Protection:
    """Learn from parts of a scene what its sparkle does.

    Parameters
    ----------
    looks : sequence of (raw, level)
        Each (band, row, column), NaN not valid: as the sensor gives it, and the level that an opening leaves (the
        level itself everywhere, not only where it replaces the band).
    bands : sequence of Band
        With wavelengths and time offsets; width is taken as 40 nm where not known.
    noise : (band, 2) array_like
        Variance at 0 [unit^2] and its increase with the signal [unit].
    irradiance : (band,) array_like, optional
        What a white thing gives, (E_direct + E_diffuse) / pi [unit]: see `daylight`; ones for a scene in reflectance.
        By default the mean glint, whose spectrum is nearly that of the sun, scaled so that the brightest pixels
        are white.
    each : callable
        What works on the looks: `map`, or the map of a pool of threads.

    Returns
    -------
    Protection
        One with a `reason`, that protects nothing, where bands are too few or see the same sparkle.

    Raises
    ------
    InputError
        Shapes that do not match, or numbers that are not positive.
    FitError
        No valid pixel, or no glint to measure the light by.

    Notes
    -----
    Things in the looks count as sparkle at first; what is found with that is left out, and all is learnt again. There
    is no test where more than `MOST_LASTING` of the sparkle stays steady through all instants, as things do.
    Cost: about 0.1 microseconds for each band of each pixel, most of it for the histograms.
    """
    noise = np.asarray(noise, dtype=np.float64)
    order, reason = instants(bands)
    if reason:
        return Protection(reason=reason)
    _check(looks, len(bands), noise, irradiance)
    chosen = list(order)
    every = chosen == list(range(len(bands)))
    pairs: list[Pair] = [(plain(r), plain(m)) if every else (plain(r[chosen]), plain(m[chosen])) for r, m in looks]
    valid = list(each(lambda pair: np.asarray(np.isfinite(pair[0] + pair[1]).all(axis=0)), pairs))
    if not any(v.any() for v in valid):
        raise FitError("the looks hold no valid pixel to learn sparkle from. Check --nodata, or widen --mask.")
    white = _glint_spectrum(pairs, valid, each) if irradiance is None else np.asarray(irradiance, np.float64)[chosen]
    water = list(each(lambda b: _middle([m[b][v] for (_, m), v in zip(pairs, valid, strict=True)]), range(len(order))))
    wavelength = [float(bands[i].wavelength or 0.0) for i in order]
    found = Protection(
        bands=order,
        irradiance=tuple(white.tolist()),
        noise=tuple((float(a), float(b)) for a, b in noise[chosen]),
        water=tuple((np.array(water) / white).tolist()),
        wavelength=tuple(wavelength),
        shapes=shapes(wavelength, [bands[i].width or WIDTH for i in order]),
        threshold=USUAL_SUM,
    )
    return _learn(pairs, valid, found, each)


def _middle(parts: Sequence[FloatArray]) -> Any:
    """Median of some arrays, of their type."""
    return np.median(np.concatenate(parts))


def _learn(pairs: Sequence[Pair], valid: Sequence[BoolArray], found: Protection, each: Each) -> Protection:
    """Tables of the chain, without things in the second round, and the threshold."""
    share = lasting(list(each(partial(steady, found), pairs, valid)))
    if share > MOST_LASTING:
        return Protection(
            reason=f"sparkle lasts: {100 * share:.1f} % of what is lit at first stays as bright at every instant"
        )
    white = np.array(found.irradiance)[:, None, None]
    kept, order = list(valid), tuple(range(len(found.bands)))
    places = list(each(lambda pair, v: binned(((pair[0] - pair[1]) / white)[:, v]), pairs, valid))
    for again in (True, False):
        first, following = tables(each(lambda p, v, k: counted(p[:, k[v]]), places, valid, kept))
        found = replace(found, first=first, following=following)
        judged = replace(found, bands=order)
        scores, masks = zip(*each(partial(_scored, judged), pairs), strict=True)
        if again:
            kept = [v & ~grown(m, REACH) for v, m in zip(valid, masks, strict=True)]
    share = sum(int(m.sum()) for m in masks) / sum(int(v.sum()) for v in valid)
    if share > MOST_THINGS:
        return Protection(
            reason=f"{100 * share:.0f} % of the pixels look like things, so the bands see the same sparkle;"
            " check their time offsets"
        )
    return replace(found, threshold=_threshold(scores, masks), around=_around(pairs, kept, white))


def _scored(judged: Protection, pair: Pair) -> tuple[Float64, BoolArray]:
    """S of a look, and what of it passes for things."""
    found = score(*pair, judged)[0]
    return found, clusters(found, USUAL_SUM)


def _around(pairs: Sequence[Pair], kept: Sequence[BoolArray], white: Float64) -> float:
    """Power of the excess in squares about pixels of sparkle, that few of them exceed."""
    import cv2

    from ._protect_kernels import SIDE

    powers = []
    for (raw, level), keep in zip(pairs, kept, strict=True):
        power = np.nan_to_num(((raw - level) / white) ** 2, nan=0.0, posinf=0.0, neginf=0.0).sum(axis=0)
        powers.append(cv2.boxFilter(power, -1, (SIDE, SIDE), normalize=False, borderType=cv2.BORDER_CONSTANT)[keep])
    return float(np.quantile(np.concatenate(powers), USUAL_AROUND))


def _threshold(scores: Sequence[Float64], masks: Sequence[BoolArray]) -> float:
    """Higher where pixels of sparkle score well more often than usual."""
    sparkle = [~grown(m, REACH + 1) for m in masks]
    high = sum(int(((s > LEAST_SCORE) & k).sum()) for s, k in zip(scores, sparkle, strict=True))
    pixels = sum(int((~np.isnan(s)).sum()) for s in scores)
    return USUAL_SUM + SUM_RISES * float(np.log(max(high / max(pixels, 1) / USUAL_RATE, 1.0)))


def _check(looks: Sequence[Look], count: int, noise: Float64, irradiance: npt.ArrayLike | None) -> None:
    for raw, level in looks:
        if raw.ndim != 3 or raw.shape != level.shape or len(raw) != count:
            raise InputError(f"looks must be ({count}, row, column) pairs, got {raw.shape} and {level.shape}")
    if noise.shape != (count, 2) or not (noise >= 0).all() or not (noise.sum(axis=1) > 0).all():
        raise InputError(f"noise must be ({count}, 2) variances that are not negative nor all 0, got {noise.tolist()}")
    if irradiance is not None:
        given = np.asarray(irradiance, np.float64)
        if given.shape != (count,) or not (given > 0).all():
            raise InputError(f"irradiance must be {count} positive numbers, got {irradiance}")


def _glint_spectrum(pairs: Sequence[Pair], valid: Sequence[BoolArray], each: Each) -> Float64:
    """Mean excess of each band, scaled to the brightest pixels."""
    excess = list(each(lambda pair, v: (pair[0] - pair[1])[:, v], pairs, valid))
    mean = np.concatenate(excess, axis=1).mean(axis=1)
    if not (mean > 0).all():
        raise FitError("the bands do not exceed their level, so there is no glint to measure the light by.")
    most = list(each(lambda e: (e / mean[:, None]).max(axis=0), excess))
    return np.asarray(mean * np.quantile(np.concatenate(most), BRIGHTEST))
