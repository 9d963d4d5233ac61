"""Glint identification: which pixels of which bands are glint.

Two ways. `IdentifyMedian`, the thesis': above the median of deep water by k lower-side standard deviations, one
threshold a band for the whole scene. Anything brighter than open water is glint to it: bright objects, shoals, foam.
`IdentifyLevel`: above the level of the water *there* (`deglint.compensate.level`) by k standard deviations. What is
larger than the element keeps its own level, so bright things of that size survive. Noise is larger on them, and an
opening sinks further by it: its distance from the commonest pixel, and the threshold, grow with the level as noise does
(`deglint.compensate.noise`), and where glint is rare, the threshold a little more.

Both take the standard deviation from below, s = 1.4826 median(m - x | x <= m), because glint only adds; it is floored
by what is known of the noise. Saturated pixels are glint.

Assumes that the darker half of what lies about the level is noise. Fails where nearly all pixels are glint: the level
and its spread are then those of faint glint, and what is replaced is too bright (it works, and the chain says so).

References
----------
Fink (2014), "Glint Avoidance and Removal in the Maritime Environment", Rochester Institute of Technology, section
6.3; Rousseeuw, Croux (1993), Journal of the American Statistical Association 88, 1273-1283,
doi:10.1080/01621459.1993.10476408 (median absolute deviation and its lower-side form)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from ..errors import FitError
from ..remove.levels import mode
from ..scene import Window
from .codes import decoded, encoded
from .evidence import grown
from .level import Grid, Opened, Witness, of_every_band, opened_level, openings_of
from .noise import Spread, growth_by_level
from .opening import opening_halo
from .spread import CERTAIN_K, COVER_K, MOST, lower_spread, spread_of_sorted, standing_out
from .state import LIMITS, Float32Array, Mask, State

THESIS_K = 5.0
"""Lower-side standard deviations above the median of deep water."""
LEVEL_K = 1.5
"""Standard deviations above the local level."""
OUTLINE_K = 2.0
"""Standard deviations that outlines add to the level, in half of the bands, where a second opening looks for some."""
MOST_COVER_FOR_DETAIL = 0.56
"""Share of glinted pixels, in the middlemost band, above which clumps of sparkle pass for outlines of objects."""
OF_THINGS = 0.2
"""Share of what a thing stands out by that glint must exceed it by, where glint is next to nowhere."""
RARE = 0.06
"""Share of glinted pixels, in the middlemost band, from which on none of that is asked for."""
MOST_COVER_FOR_NOISE = 0.3
"""Share of glinted pixels, in the middlemost band, from which on sparkle passes for noise, and grows with the level."""
FEWEST = 64
"""Fewest pixels that a level and a spread are taken from."""
LEAST_UNIT = 1e-6
"""Of the median: levels need not be told more finely than float32 tells them."""
TINY = float(np.finfo(np.float32).tiny)
"""Standard deviation of a band without noise, and brightness of no glint: nothing is divided by 0."""


@dataclass(frozen=True)
class IdentifyMedian:
    """Glint is what exceeds a threshold.

    Attributes
    ----------
    thresholds : tuple of float
        Of each band, in the unit of the image at that stage.
    saturation : tuple of float
        Of each band; infinity where not known.
    """

    name: ClassVar[str] = "identify-median"
    thresholds: tuple[float, ...]
    saturation: tuple[float, ...]

    @property
    def halo(self) -> int:
        """None: it looks at single pixels."""
        return 0

    def apply(self, state: State) -> None:
        """Mark glint."""
        state.hit = _above(state, [np.float32(t) for t in self.thresholds], self.saturation)


@dataclass(frozen=True)
class IdentifyLevel:
    """Glint is what exceeds the level of the water beside it.

    Attributes
    ----------
    size, detail : int
        Elements of the openings [pixel]; see `deglint.compensate.level.opened_level`.
    order : tuple of int
        Bands by wavelength.
    bands : tuple of int
        Bands that are looked at.
    grids : tuple of (float, float)
        Of each of them: centre and unit in which levels are told; see `deglint.compensate.codes`.
    spectrum, offsets, sigmas, cover : tuple of float
        Of each of them: brightness of glint, how far the commonest pixel lies above the opening, standard deviation
        of pixels without glint about that, and share of glinted pixels in the sample.
    saturation : tuple of float
        Of each band.
    k : float
        Standard deviations.
    glint, things : tuple of float
        Of each of the bands that are looked at, where the NIR is known: what glint and what other bright things add to
        the variance of the sample, in variances of pixels without glint; see `standing_out`.
    growths : tuple of (float, float)
        Of each of them: by what share of itself noise, and with it offset and standard deviation, grows with the level
        above the centre of the grid, per unit, and at most; none where it is not known.
    share : float
        Of what the level lies above that centre: by so much more glint exceeds it.
    left : tuple of int
        Bands that are looked at for their outlines alone, and left as they are.
    witness : int, optional
        Of these bands the one that shows glint wherever another does, where they see the sea at one instant: outlines
        count as far as it has none.
    """

    name: ClassVar[str] = "identify-level"
    size: int
    detail: int
    order: tuple[int, ...]
    bands: tuple[int, ...]
    grids: tuple[Grid, ...]
    spectrum: tuple[float, ...]
    offsets: tuple[float, ...]
    sigmas: tuple[float, ...]
    cover: tuple[float, ...]
    saturation: tuple[float, ...]
    k: float = LEVEL_K
    glint: tuple[float, ...] = ()
    things: tuple[float, ...] = ()
    growths: tuple[tuple[float, float], ...] = ()
    share: float = 0.0
    left: tuple[int, ...] = ()
    witness: int | None = None

    @property
    def halo(self) -> int:
        """Reach of the openings; what the level is blurred with comes on top, and is counted with the sharpening."""
        return opening_halo(self.size, self.detail) + (0 if self._seen is None else self._seen.reach)

    @property
    def _seen(self) -> Witness | None:
        """What the openings are to know of the witness."""
        if self.witness is None or not self.detail:
            return None
        sure = [offset + CERTAIN_K * sigma for offset, sigma in zip(self.offsets, self.sigmas, strict=True)]
        return Witness(self.bands.index(self.witness), sure, self.size // 2)

    @property
    def spreads(self) -> list[Spread]:
        """How pixels without glint lie about the level, in each of the bands that are looked at."""
        growths = self.growths or ((0.0, 0.0),) * len(self.bands)
        each = zip(self.bands, self.sigmas, self.grids, growths, strict=True)
        return [Spread(band, sigma, middle, *growth, self.share) for band, sigma, (middle, _), growth in each]

    def apply(self, state: State) -> None:
        """Find the level and mark what exceeds it."""
        least = [OUTLINE_K * sigma for sigma in self.sigmas] if state.outlined is None else []  # told once
        level, outlined = _levels(
            state,
            self.bands,
            self.grids,
            self.size,
            self.detail,
            self.order,
            self.spectrum,
            least=least,
            later=True,
            witness=self._seen,
        )
        state.cut()
        limits = np.zeros((len(state.image), LIMITS), np.float32)
        for offset, (band, sigma, *growth) in zip(self.offsets, self.spreads, strict=True):
            rise, full = self.k * sigma, float(_as_divided(self.saturation[band], state.units[band]))
            if band in self.left:
                rise = full = np.inf
            limits[band] = offset, rise, full, *growth
        if not isinstance(level, Opened):
            level = of_every_band(level, self.bands, len(state.image))
            state.outlined = state.outlined if outlined is None else outlined
        state.found(level, limits)


def fit_identify_median(
    values: Sequence[npt.NDArray[np.floating[Any]]],
    saturation: Sequence[float],
    *,
    k: float = THESIS_K,
    floor: Sequence[float] | None = None,
) -> IdentifyMedian:
    """Thresholds from a sample of deep water.

    Parameters
    ----------
    values : sequence of (pixels,) ndarray
        The sample, one array a band.
    saturation : sequence of float
        Of each band, in the image's unit; infinity where not known.
    k : float
        Lower-side standard deviations above the median.
    floor : sequence of float, optional
        Least standard deviation of each band: what is known of the noise.
    """
    thresholds = []
    for i, sample in enumerate(values):
        middle = float(np.median(sample))
        thresholds.append(middle + k * max(lower_spread(sample, middle), floor[i] if floor else 0.0))
    return IdentifyMedian(tuple(thresholds), tuple(map(float, saturation)))


def fit_identify_level(
    states: Sequence[State],
    inside: Sequence[Mask],
    *,
    size: int,
    order: Sequence[int],
    saturation: Sequence[float],
    detail: int = 0,
    k: float = LEVEL_K,
    bands: Sequence[int] | None = None,
    left: Sequence[int] = (),
    floor: Sequence[float] | None = None,
    steps: Sequence[float] | None = None,
    nir: int | None = None,
    witness: int | None = None,
    cover_before: float = 0.0,
    each: Callable[..., Iterable[Any]] = map,
) -> IdentifyLevel:
    """How pixels without glint lie about the opened level.

    Parameters
    ----------
    states : sequence of State
        Blocks of the scene with their halos.
    inside : sequence of (row, column) bool ndarray
        Their pixels of deep water, without the halos.
    size, detail : int
        Elements [pixel]. The detail is left out above `MOST_COVER_FOR_DETAIL`, but where there is a witness.
    order : sequence of int
        Bands by wavelength.
    saturation : sequence of float
        Of each band.
    k : float
        Standard deviations above which a pixel is glint.
    bands : sequence of int, optional
        Bands to find glint in; all by default.
    left : sequence of int
        Others, to be looked at for their outlines, where those are compared.
    floor : sequence of float, optional
        Least standard deviation of each band of the scene.
    steps : sequence of float, optional
        Of the numbers of each band of the scene, where they come in whole steps.
    nir : int, optional
        The NIR, by which glint is told from other bright things, where that is wanted.
    witness : int, optional
        Band that shows glint wherever another does, where bands see the sea at one instant; none where it is not one of
        those that are looked at.
    cover_before : float
        Share of glinted pixels before any was replaced, in the middlemost band, where that is known: the rest is no
        rarer.
    each : callable
        What works on the blocks: `map`, or the map of a pool of threads.

    Raises
    ------
    FitError
        Too few pixels to tell the spread of.
    """
    changed = set(range(len(states[0].image)) if bands is None else bands)
    chosen = tuple(sorted(changed | set(left) if detail else changed))
    grids = tuple(each(lambda b: _grid([s.image[b][m] for s, m in zip(states, inside, strict=True)]), chosen))
    unlike = states[0].sharp is not None  # a sharpened level is no pixel found again
    apart = max(sum(int(m.sum()) for m in inside) // MOST, 1)

    def above(state: State, mask: Mask) -> list[tuple[Float32Array, tuple[Float32Array, Float32Array]]]:
        rows, columns = wanted = _around(mask)
        at = slice(*rows), slice(*columns)
        level, _ = _levels(state, chosen, grids, size, 0, order, (), wanted)
        assert not isinstance(level, Opened)
        image = [np.ascontiguousarray(state.image[b][at]) for b in chosen]
        if not unlike:
            image = [decoded(encoded(band, *grid), *grid) for band, grid in zip(image, grids, strict=True)]
        known, found = mask[at], []
        for rest, there in zip(map(np.subtract, image, level), level, strict=True):
            some = np.where(known[::apart], rest[::apart], np.float32(np.nan))
            found.append((rest[known], (some, there[::apart].copy())))
        return found

    seen = list(zip(*each(above, states, inside), strict=True))
    away = [np.concatenate([rest for rest, _ in band]) for band in seen]
    whole = steps if states[0].psfs is None else None  # a blurred level is no whole number

    def about(away: Float32Array, band: int) -> tuple[float, ...]:
        return _about(away, floor[band] if floor else 0.0, whole[band] if whole else 0.0)

    found = each(about, away, chosen)
    offsets, sigmas, cover, spectrum = zip(*found, strict=True)
    ranks = tuple(b for b in order if b in chosen)
    powers: list[tuple[float, ...]] = [(), ()]
    if nir in chosen:
        places = [chosen.index(b) for b in ranks]
        powers = list(standing_out(away, offsets, sigmas, places, chosen.index(nir)))
    middle, growths = float(np.median(cover)), list[tuple[float, float]]()
    witness = witness if witness in chosen else None
    use, most_cover = detail if middle <= MOST_COVER_FOR_DETAIL or witness is not None else 0, max(middle, cover_before)
    told = max(1 - most_cover / MOST_COVER_FOR_NOISE, 0.0)
    if told:
        looks, centres = [[look for _, look in band] for band in seen], [centre for centre, _ in grids]
        growths = [(told * slope, told * most) for slope, most in each(growth_by_level, looks, centres)]
    return IdentifyLevel(
        size, use, ranks, chosen, grids, spectrum, offsets, sigmas, cover, tuple(map(float, saturation)), k,
        powers[0], powers[1], tuple(growths), _share(most_cover), tuple(b for b in chosen if b not in changed),
        witness,
    )  # fmt: skip


def _share(cover: float) -> float:
    """Of what the level lies above the water, by which glint is to exceed it more.

    The top of a blurred thing, hardly wider than the element, sinks by a part of its height, and passes for glint.
    Where there is next to none it rather is that thing.
    """
    return OF_THINGS * max(1 - cover / RARE, 0.0)


def standing_out_of_outlines(
    stage: IdentifyLevel, states: Sequence[State], inside: Sequence[Mask], nir: int, *, each: Callable[..., Any] = map
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """`standing_out` of a level that keeps the outlines of things: of those, what an opening takes for glint.

    What is left of such things may stand out in a single band, as glint does. So glint is told an element away from
    them.

    Parameters
    ----------
    stage : IdentifyLevel
        Fitted to the same blocks.
    states, inside : sequence of State, sequence of (row, column) bool ndarray
        As for `fit_identify_level`.
    nir : int
        0-based, one of the bands that are looked at.
    each : callable
        What works on the blocks.
    """
    least = [OUTLINE_K * sigma for sigma in stage.sigmas]

    def above(state: State, mask: Mask) -> tuple[list[Float32Array], list[Float32Array]]:
        wanted = _around(mask)
        at, seen = (slice(*wanted[0]), slice(*wanted[1])), stage._seen
        level, outlined = _levels(
            state, stage.bands, stage.grids, stage.size, stage.detail, stage.order, stage.spectrum, wanted,
            least=least, witness=seen,
        )  # fmt: skip
        assert not isinstance(level, Opened)
        some = mask[at] if outlined is None else mask[at] & ~grown(outlined, stage.size)
        rest = [state.image[b][at] - m for b, m in zip(stage.bands, level, strict=True)]
        return [r[mask[at]] for r in rest], [r[some] for r in rest]

    places = [stage.bands.index(b) for b in stage.order]

    def told(parts: Iterable[Any]) -> tuple[tuple[float, ...], tuple[float, ...]]:
        away = [np.concatenate(band) for band in zip(*parts, strict=True)]
        return standing_out(away, stage.offsets, stage.sigmas, places, stage.bands.index(nir))

    everywhere, far = zip(*each(above, states, inside), strict=True)
    return told(far)[0], told(everywhere)[1]


def _about(away: npt.NDArray[np.floating[Any]], floor: float, step: float = 0.0) -> tuple[float, float, float, float]:
    """Offset, standard deviation, cover and mean glint from pixels less their opened level."""
    away = away[np.isfinite(away)]
    if step > 0:
        away = np.rint(away.astype(np.float64) / step) * step  # without the rounding of single precision
    if away.size < FEWEST:
        raise FitError(
            f"{away.size} pixels of deep water near each other, need {FEWEST} to tell glint from the water beside it. "
            "Pass --sample, or --compensate off."
        )
    away = away[:: max(away.size // MOST, 1)]
    apart = away[away != 0]  # a pixel that the opening found again is no measure of the noise
    if apart.size < FEWEST:
        return 0.0, max(floor, TINY), 0.0, TINY
    apart.sort()
    offset = mode(apart, ordered=True)
    sigma = max(spread_of_sorted(apart, offset, step), floor, TINY)
    cover = float(np.mean(away > offset + COVER_K * sigma))
    return offset, sigma, cover, max(float(away.mean(dtype=np.float64)), TINY)


def _grid(values: Sequence[npt.NDArray[np.float32]]) -> Grid:
    """Centre and unit of a band: the median of its sample, and the spread below that."""
    sample = np.concatenate(values)
    sample = np.sort(sample[np.isfinite(sample)][:: max(sample.size // MOST, 1)])
    centre = float(np.median(sample[[(sample.size - 1) // 2, sample.size // 2]])) if sample.size else 0.0
    return centre, max(spread_of_sorted(sample, centre), LEAST_UNIT * abs(centre), TINY)


def _levels(
    state: State, bands: Sequence[int], grids: Sequence[Grid], size: int, detail: int, order: Sequence[int],
    spectrum: Sequence[float], wanted: Window | None = None, *, least: Sequence[float] = (), later: bool = False,
    witness: Witness | None = None,
) -> tuple[Float32Array | Opened, Mask | None]:  # fmt: skip
    """Opened level of some bands, and its outlines; `order` and `spectrum` are of the scene's bands and of the chosen
    ones.

    later : the openings will do, of which the level is made
    """
    place = {band: i for i, band in enumerate(bands)}
    psfs = None if state.psfs is None else [state.psfs[b] for b in bands]
    wanted = wanted or state.inner()
    reach = opening_halo(size, detail) + max((p.radius for p in psfs or ()), default=0)
    reach += 0 if witness is None else witness.reach
    (top, bottom), (left, right) = (
        (max(a - reach, 0), min(b + reach, n)) for (a, b), n in zip(wanted, state.image.shape[1:], strict=True)
    )
    outer = (top, bottom), (left, right)
    sharp = state.sharp or (lambda b, _outer: state.image[b][top:bottom, left:right])
    source = (sharp(b, outer) for b in bands)
    within = tuple((a - c, b - c) for (a, b), (c, _) in zip(wanted, outer, strict=True))
    shape = (len(bands), bottom - top, right - left)
    known = None if state.outlined is None else grown(state.outlined, 1)[top:bottom, left:right]
    some = [place[b] for b in order if b in place]
    if later and psfs is None:
        opened = openings_of(
            source,
            shape,
            size,
            grids,
            detail=detail,
            order=some,
            spectrum=spectrum,
            within=(within[0], within[1]),
            where=known,
            witness=witness,
        )
        return replace(opened, bands=tuple(bands), least=least), None
    return opened_level(
        source, shape, size, grids, detail=detail, order=some, spectrum=spectrum, psfs=psfs,
        within=(within[0], within[1]), where=known, least=least, witness=witness, sound=state.sound,
    )  # fmt: skip


def _around(mask: Mask) -> Window:
    """Rows and columns that hold all of a mask; of an empty one, a single pixel."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if not rows.size:
        return (0, 1), (0, 1)
    return (int(rows[0]), int(rows[-1]) + 1), (int(columns[0]), int(columns[-1]) + 1)


def _above(state: State, limits: Sequence[Any], saturation: Sequence[float]) -> Mask:
    """Pixels above their limits, or saturated, that may be changed."""
    hit = np.empty(state.image.shape, np.bool_)
    for b, (band, limit, full) in enumerate(zip(state.image, limits, saturation, strict=True)):
        np.greater(band, limit, out=hit[b])
        if np.isfinite(full):
            hit[b] |= band >= _as_divided(full, state.units[b])
    if state.where is not None:
        hit &= state.where
    return hit


def _as_divided(full: float, unit: float) -> np.float32:
    """A band's saturation, divided as the band was."""
    return np.float32(full) / np.float32(unit)
