"""What speaks for a thing and what for sparkle, pixel by pixel: the model behind `deglint.compensate.protect`.

For each pixel the excess over the level of the water is turned into reflectance y and judged by

.. math:: S = \\ln \\max_k w_k \\, p(y \\mid \\mathrm{shape}\\ k) - \\ln p(y_1) \\prod_i p(y_{i+1} \\mid y_i)

The first term is the marginal likelihood of a mixture of reflectance shapes (`deglint.compensate.shapes`): normal, with
brightness, slope and bend unknown, over water that is partly hidden, with the noise of the sensor. The second is what
the scene's own sparkle does from one instant to the next: a Markov chain in the order of time, as histograms.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..scene import FloatArray
from .shapes import CENTRE, SPAN, Shapes

if TYPE_CHECKING:
    from ._glance_kernels import Steps

Float64 = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Places = npt.NDArray[np.int64]

STRIP = 128
"""Rows that are glanced at together: so many at a time that what is found of all of them need not be held."""
AT_ONCE = 4096
"""Pixels that are weighed in full at a time."""
REACH = 2
"""Pixels around a thing that its blurred edge reaches."""
HALO = 2 + REACH
"""Pixels around a tile that `things` looks at: 3 x 3 sums, their neighbours, and the edge."""
STANDS_OUT = 4.0
"""A pixel is looked at where two bands exceed the level by this many standard deviations."""
LEAST_SCORE = 2.0
"""S from which a pixel may be part of a thing."""
WATER_HIDDEN = (0.75, 0.25)
"""Mean and standard deviation of the part of a pixel's water that a thing hides."""
TEXTURE = 0.05
"""Standard deviation of the level itself, as a share."""
UNIT, BINS, LOW, HIGH = 0.001, 64, -3.0, 8.5
"""Histograms of asinh(reflectance / UNIT)."""
BLUR = 1.2
"""Smoothing of the histograms [bin]."""


@dataclass(frozen=True, eq=False)
class Protection:
    """How things are told from sparkle in a scene.

    Attributes
    ----------
    bands : tuple of int
        0-based bands that are judged, in the order in which they look.
    irradiance : tuple of float
        What a white thing gives in each of `bands` [unit of the scene per reflectance].
    noise : tuple of (float, float)
        Variance of each at 0, and its increase per unit of signal.
    water : tuple of float
        Level of the water in each [reflectance].
    shapes : Shapes
    wavelength : tuple of float
        [nm]
    first, following : ndarray
        Log density of the first band, (bin,), and of each next one given the last, (band - 1, bin, bin).
    threshold : float
        On the 3 x 3 sum of S.
    around : float
        Power that 5 x 5 pixels of sparkle usually have at most [reflectance squared, summed over bands and pixels].
    reason : str
        Why the test is not possible; empty where it is.
    """

    bands: tuple[int, ...] = ()
    irradiance: tuple[float, ...] = ()
    noise: tuple[tuple[float, float], ...] = ()
    water: tuple[float, ...] = ()
    wavelength: tuple[float, ...] = ()
    threshold: float = np.inf
    around: float = np.inf
    reason: str = ""
    shapes: Shapes | None = field(default=None, repr=False)
    first: Float64 | None = field(default=None, repr=False)
    following: Float64 | None = field(default=None, repr=False)

    @property
    def possible(self) -> bool:
        """Whether there is a test; without one nothing is protected."""
        return not self.reason

    @cached_property
    def steps(self) -> Steps:
        """Tables of the first look, made when they are first needed."""
        from .glance import steps

        return steps(self)

    @property
    def halo(self) -> int:
        """Pixels that `things` needs around a tile."""
        return HALO if self.possible else 0

    def numbers(self) -> dict[str, Any]:
        """What goes into a sidecar: all but the tables."""
        names = "bands", "irradiance", "noise", "water", "wavelength", "reason"
        limits = {name: getattr(self, name) for name in ("threshold", "around")}
        known = {
            name: value if np.isfinite(value) else None for name, value in limits.items()
        }  # JSON knows no infinity
        return {name: getattr(self, name) for name in names} | known | {"halo": self.halo}

    def saved(self) -> dict[str, Any]:
        """Everything as plain numbers, tables and all, to be read back by `protection_from`."""
        data = {k: v for k, v in self.numbers().items() if k != "halo"}
        if self.shapes is None or self.first is None or self.following is None:
            return data
        kinds = {k: v.tolist() for k, v in asdict(self.shapes).items()}
        return data | {"shapes": kinds, "first": self.first.tolist(), "following": self.following.tolist()}


def protection_from(data: Mapping[str, Any]) -> Protection:
    """Read back what `Protection.saved` says."""
    plain = {k: v for k, v in data.items() if k not in ("shapes", "first", "following", "halo")}
    for name in ("threshold", "around"):
        plain[name] = np.inf if plain.get(name) is None else plain[name]
    for name in ("bands", "irradiance", "water", "wavelength"):
        plain[name] = tuple(plain[name])
    plain["noise"] = tuple((float(a), float(b)) for a, b in plain["noise"])
    if "shapes" not in data:
        return Protection(**plain) if plain["reason"] else Protection(reason="saved without its tables")
    arrays: dict[str, Any] = {k: np.array(v, np.int64 if k == "odd" else np.float64) for k, v in data["shapes"].items()}
    return Protection(
        **plain, shapes=Shapes(**arrays), first=np.array(data["first"]), following=np.array(data["following"])
    )


@dataclass(frozen=True, eq=False)
class Weighed:
    """Pixels that were weighed in full.

    Attributes
    ----------
    places : (pixel,) ndarray of int
        Where they are in the image, in order.
    score : (pixel,) ndarray
        S by the best shape.
    spectra : (pixel, band) ndarray
        Of that shape, less the water that it hides [reflectance].
    residual : (pixel,) ndarray
        What is left of the excess, relative to it.
    excess, noise : (band, pixel) ndarray
        Over the level, and standard deviation [reflectance].
    """

    places: Places
    score: Float64
    spectra: Float64
    residual: Float64
    excess: Float64
    noise: Float64


def binned(y: Float64) -> npt.NDArray[np.uint8]:
    """The bins of reflectances."""
    step = (HIGH - LOW) / BINS
    place = [np.clip(((np.arcsinh(b / UNIT) - LOW) / step).astype(np.int64), 0, BINS - 1) for b in y]
    return np.array(place, np.uint8)


def counted(place: npt.NDArray[np.uint8]) -> tuple[Places, Places]:
    """Pixels in each bin, (band, bin), and in each pair of bins of a band and the next, from (band, pixel) bins."""
    wide = place.astype(np.int64)
    single = np.array([np.bincount(p, minlength=BINS) for p in wide])
    return single, np.array([np.bincount(p * BINS + q, minlength=BINS * BINS) for p, q in pairwise(wide)])


def tables(parts: Iterable[tuple[Places, Places]]) -> tuple[Float64, Float64]:
    """Log densities of the chain from the counts of some parts; rare steps lean on the next band's own histogram."""
    import cv2

    step, side, same = (HIGH - LOW) / BINS, 2 * round(4 * BLUR) + 1, cv2.BORDER_REPLICATE
    single, double = (np.array(counts, np.float64).sum(axis=0) for counts in zip(*parts, strict=True))
    alone = np.asarray(cv2.GaussianBlur(single, (side, 1), BLUR, borderType=same)) + 0.3
    alone /= alone.sum(axis=1, keepdims=True)
    following = []
    for pairs, after in zip(double, alone[1:], strict=True):
        blurred = cv2.GaussianBlur(pairs.reshape(BINS, BINS), (side, side), BLUR, borderType=same)
        table = np.asarray(blurred) + 3 * after
        following.append(np.log(table / table.sum(axis=1, keepdims=True) / step))
    return np.log(alone[0] / step), np.array(following)


def bends(wavelength: Sequence[float]) -> Float64:
    """The linear and the quadratic factor by which things may differ from their shape, (2, band)."""
    u = (np.array(wavelength) - CENTRE) / SPAN
    return np.array([u, u**2 - (u**2).mean()])


def score(
    raw: FloatArray, level: FloatArray, protection: Protection, threshold: float = -np.inf
) -> tuple[Float64, Float64, Places]:
    """S (row, column), and of the pixels that were weighed in full the best spectrum (band, pixel) and the place.

    Parameters
    ----------
    raw, level : (band, row, column) ndarray of float32 or float64
        All bands of the block.
    protection : Protection
    threshold : float
        Pixels are weighed only where a 3 x 3 sum of S may reach it.

    Notes
    -----
    A pixel is weighed in full where the first look (`deglint.compensate.glance`) leaves room for S above `LEAST_SCORE`
    in it, and for the threshold in a square around it; elsewhere S is minus infinity.
    """
    missing, found = weighed(raw, level, protection, threshold)
    score = np.where(missing, np.nan, -np.inf)
    score.ravel()[found.places] = found.score
    return score, found.spectra.T, found.places


def weighed(raw: FloatArray, level: FloatArray, protection: Protection, threshold: float) -> tuple[BoolArray, Weighed]:
    """As for `score`: where there is no number, and the pixels weighed in full."""
    from ._glance_kernels import KINDS, glance, weigh
    from .glance import MOST_ROOM, QUARTERS, ROOM, block

    dtype, shape, steps = raw.dtype, raw.shape[1:], protection.steps
    bands, white = np.array(protection.bands), np.array(protection.irradiance)
    limit = dtype.type(STANDS_OUT) * dtype.type(STANDS_OUT)
    sensor = bands, (1 / (white * UNIT)).astype(dtype), np.array(protection.noise, dtype), limit
    least = max(int(np.floor((LEAST_SCORE - ROOM) * QUARTERS)), -MOST_ROOM)
    missing, size, parts = np.empty(shape, np.bool_), min(STRIP, shape[0]) * shape[1], []
    room = np.empty(size, np.int64), np.empty((size, bands.size - 1), np.uint16)
    for first in range(0, max(shape[0], 1), STRIP):
        part = slice(first, first + STRIP)
        look = block(raw[:, part]), block(level[:, part])
        count = glance(look, sensor, steps, least, missing[part], room)
        listed = room[0][:count], room[1][:count]
        totals, most = np.empty((count, KINDS), np.int16), np.empty(count, np.int32)
        count = weigh(count, steps, least, listed, totals, most)
        parts.append((listed[0][:count] + first * shape[1], *(a[:count].copy() for a in (listed[1], totals, most))))
    places, rows, totals, most = (np.concatenate(each) for each in zip(*parts, strict=True))
    del room, listed, parts
    some, whole = _near(places, most / QUARTERS + ROOM, shape, threshold), (block(raw), block(level), shape[1])
    turns = np.array_split(some, max(-(-some.size // AT_ONCE), 1))
    return missing, _joined([_explained(whole, protection, places[t], (rows, totals, t)) for t in turns])


def _joined(parts: Sequence[Weighed]) -> Weighed:
    """Pixels one after the other."""
    along = {"excess": 1, "noise": 1}
    each = {f.name: [getattr(part, f.name) for part in parts] for f in fields(Weighed)}
    return Weighed(**{name: np.concatenate(some, axis=along.get(name, 0)) for name, some in each.items()})


def _explained(look: Any, protection: Protection, places: Places, seen: Any) -> Weighed:
    """Some pixels by the best shape of each; seen : of more pixels rows and sums of steps, and which they are."""
    from ._explain_kernels import chain, choose, gather, in_turn, shaped
    from .glance import QUARTERS, ROOM_OF_SHAPE

    s, first, following = protection.shapes, protection.first, protection.following
    assert s is not None and first is not None and following is not None  # noqa: PT018
    white, water, bent = np.array(protection.irradiance), np.array(protection.water), bends(protection.wavelength)
    left, hidden = WATER_HIDDEN[0] * water, WATER_HIDDEN[1] * water
    y, deviation, x, variance = np.empty((4, water.size, places.size))
    sensor = np.array(protection.bands), white, np.array(protection.noise), left, (TEXTURE * water) ** 2
    gather(look, places, sensor, y, deviation, x, variance)
    (rows, totals, which), lasts = seen, np.empty(places.size)
    chain(y, rows, which, first, following.ravel(), UNIT, lasts)
    least = int(np.floor((LEAST_SCORE - ROOM_OF_SHAPE) * QUARTERS))
    pairs = np.empty((places.size * len(s.weight), 3), np.int32)
    pairs = pairs[: in_turn(totals, which, len(s.weight), least, pairs)]
    spread = np.stack([s.slope, s.bend, s.rough], axis=1)
    tried = np.empty((6, len(pairs)))
    shaped(x, variance, pairs, (s.values, spread, s.odd), bent, hidden, tried)
    found = np.full(places.size, -np.inf), np.zeros((places.size, water.size)), np.empty(places.size)
    kinds, limits = (s.values, spread, np.log(s.weight)), (1 / QUARTERS, ROOM_OF_SHAPE, LEAST_SCORE)
    choose(pairs, tried, lasts, y, kinds, (bent, left, hidden), limits, found)
    return Weighed(places, *found, y, deviation)


def _near(places: Places, values: Float64, shape: tuple[int, ...], threshold: float) -> Places:
    """Which of some pixels, in order, are in a 3 x 3 square over which values sum up to the threshold."""
    from ._glance_kernels import squares

    which, reached = np.empty(places.size + 1, np.int64), np.zeros((shape[0] + 2, shape[1] + 2), np.bool_)
    return which[: squares(places, values, threshold, reached, which)]


def excess(raw: FloatArray, level: FloatArray, protection: Protection, places: Places) -> Float64:
    """Of some pixels the excess over the level [reflectance], (band, pixel)."""
    at = np.array(protection.bands)[:, None], *np.divmod(places, raw.shape[2])
    with np.errstate(invalid="ignore"):
        more = raw[at].astype(np.float64) - level[at].astype(np.float64)
    return np.asarray(more / np.array(protection.irradiance)[:, None])


def plain(block: FloatArray) -> FloatArray:
    """The block as floating-point numbers; itself where it is."""
    return np.asarray(block, np.float64 if block.dtype != np.float32 else np.float32)


def clusters(score: FloatArray, threshold: float) -> BoolArray:
    """Pixels of high S in a 3 x 3 square over which that sums up to the threshold."""
    mask, places = np.zeros(score.shape, np.bool_), np.flatnonzero(score > LEAST_SCORE)
    mask.ravel()[places[_near(places, score.ravel()[places].astype(np.float64), score.shape, threshold)]] = True
    return mask


def grown(mask: BoolArray, reach: int) -> BoolArray:
    """The mask and all pixels within a square of `reach` around each of its own."""
    import cv2

    if not mask.any():
        return mask
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.asarray(cv2.dilate(mask.view(np.uint8), square, borderType=cv2.BORDER_CONSTANT)).view(np.bool_)
