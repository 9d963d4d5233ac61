"""What a scene needs, and what it does not: numbers from a cheap look, each beside the threshold that it is held to.

Four questions. Is there glint at all, and how much of each band does it cover? Do the bands see the sea at the same
instant, as the image itself says? How large is what must survive, in pixels? Is the sensor's blur known? From the
answers follows which stages run. Arrays and numbers only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from .compensate.level import LARGEST, SMALLEST
from .scene import Band, FloatArray

Mask = npt.NDArray[np.bool_]

SIMULTANEOUS = 0.93
"""Coherence of high-passed bands above which they see the sea at one instant."""
LITTLE_GLINT = 0.02
"""Share that glint adds to a band's variance of noise, below which its error could not fall by 1 %."""
CLEAR_GLINT = 1.0
"""The same, above which a band is compensated whatever else is bright in it."""
FAINTER = 2.0
"""How many times what stands out beyond doubt all glint is taken to add."""
PSF_COVER = 0.03
"""Share of glinted pixels below which sharpening gains nothing."""
RARE_COVER = 0.35
"""Share below which water shows within two pixels less, too, so that a smaller element leaves more of a round thing."""
HEAVY_COVER = 0.6
"""Share above which a method works, and warns."""
HIGH_PASS = 9
"""Side of the window whose mean is taken off before coherence is told [pixel]."""
SMALLEST_OBJECT = 4.0
"""What must survive where the user does not say [m]."""
UNKNOWN_OBJECT = 16.0
"""The same in pixels, where the size of a pixel is not known."""
ELEMENT_SHARE = 0.85
"""Of the smallest object's width, that an element may have."""


@dataclass(frozen=True)
class StageNeed:
    """One stage, whether it runs, why, and what skipping it saves."""

    stage: str
    runs: bool
    why: str
    saves: str = ""

    def __str__(self) -> str:
        return f"{self.stage}: {'runs' if self.runs else 'skipped'}, {self.why}" + (
            f" (saves {self.saves})" if self.saves and not self.runs else ""
        )


@dataclass(frozen=True)
class Needs:
    """What was found, and what follows.

    Attributes
    ----------
    pixel : float or None
        Side of a pixel [m].
    smallest : float
        Width of the smallest thing that must survive [pixel].
    element : int
        Element of the opening [pixel]; 0 where none is small enough.
    coherence : float or None
        Largest high-pass correlation of the NIR with another band (the smallest, where the file says that they look one
        after the other); None where it cannot be told.
    cover : tuple of float
        Share of glinted pixels of each band beside its opened level; empty where it was not told.
    nir : int or None
        The NIR, 0-based, where what is too bright in it is left out of what was looked at.
    glint, things : tuple of float
        What glint, and what other bright things, add to the variance of each band [of its noise] above an opened level;
        where it depends on that whether a band gains, above a level that keeps outlines.
    calm : float
        Share of the sample where the NIR shows no glint, which compensation leaves as it is, or without removal.
    offsets : float or None
        Longest time between the NIR and another band that the file or sensor says [s].
    optics : str
        "known", or "estimated" or "unknown" and why.
    stages : tuple of StageNeed
    """

    pixel: float | None = None
    smallest: float = UNKNOWN_OBJECT
    element: int = 0
    coherence: float | None = None
    cover: tuple[float, ...] = ()
    nir: int | None = None
    glint: tuple[float, ...] = ()
    things: tuple[float, ...] = ()
    calm: float = 0.0
    offsets: float | None = None
    optics: str = "unknown"
    stages: tuple[StageNeed, ...] = field(default=())

    @property
    def simultaneous(self) -> bool:
        """The image says that its bands see the sea at one instant."""
        return self.coherence is not None and self.coherence >= SIMULTANEOUS

    @property
    def glinted(self) -> tuple[int, ...]:
        """Bands that gain by compensation.

        The level of the water stands in for whatever rises from it, glint or the corner of a thing. So a band gains
        where glint adds something to it, and that is clear, or more than such things add. Where a sample leaves
        out what is too bright for water in the NIR, and the NIR has clear glint yet, every band has more.
        """
        if self.nir is not None and self.glint and self.glint[self.nir] >= CLEAR_GLINT:
            return tuple(range(len(self.glint)))
        found = enumerate(zip(self.glint, self.things, strict=True))
        return tuple(b for b, (g, t) in found if g >= max(LITTLE_GLINT, min(CLEAR_GLINT, t / FAINTER)))

    @property
    def in_doubt(self) -> tuple[int, ...]:
        """Bands with glint in which other bright things add more, above a level without their outlines."""
        return tuple(b for b, g in enumerate(self.glint) if g >= LITTLE_GLINT and b not in self.glinted)

    @property
    def smooth(self) -> bool:
        """It was looked for what stands out of the water beside it, and no glint does: the rest is wider than that."""
        return bool(self.glint) and not self.glinted

    def without(self, stage: str, why: str) -> Needs:
        """The same, with a stage that turned out not to be needed."""
        stages = tuple(StageNeed(stage, False, why) if s.stage == stage else s for s in self.stages)
        return replace(self, stages=stages)

    def lines(self) -> list[str]:
        """What to say, one line each."""
        out = []
        if self.element or self.pixel is not None:
            size = "pixels of unknown size" if self.pixel is None else f"pixels of {self.pixel:.3g} m"
            found = (
                f"an opening of {self.element} pixels" if self.element else f"too small for an opening of {SMALLEST}"
            )
            if 0 < self.element < element_for(self.smallest):
                found += f": less than fits, as glint covers less than {RARE_COVER:.0%}"
            out.append(f"{size}: the smallest object to keep is {self.smallest:.3g} pixels wide, {found}")
        if self.coherence is not None:
            said = "at one instant" if self.simultaneous else "at different instants"
            told = "" if self.offsets is None else f"; told: up to {1e3 * self.offsets:.0f} ms from the NIR"
            out.append(f"bands see the sea {said}: coherence {self.coherence:.2f} (threshold {SIMULTANEOUS}){told}")
        if self.cover:
            covers = " ".join(f"{100 * c:.0f}" for c in self.cover)
            out.append(f"glint stands above the water beside it in, by band, {covers} % of the pixels")
        if self.calm:
            out.append(f"the NIR shows no glint in {self.calm:.0%} of the sample: nothing is removed in such parts")
        if self.optics != "known" and self.element and self.stages:
            out.append(f"optics: {self.optics}")
        return out + [str(stage) for stage in self.stages]

    def numbers(self) -> dict[str, Any]:
        """The same for the sidecar."""
        return {
            "pixel_m": self.pixel, "smallest_object_pixels": self.smallest, "element_pixels": self.element,
            "coherence": self.coherence, "coherence_threshold": SIMULTANEOUS, "simultaneous": self.simultaneous,
            "time_offset_s": self.offsets, "cover": list(self.cover),
            "glint": list(self.glint), "glint_threshold": LITTLE_GLINT, "things": list(self.things),
            "calm": self.calm,
            "optics": self.optics,
            "stages": [{"stage": s.stage, "runs": s.runs, "why": s.why, "saves": s.saves} for s in self.stages],
        }  # fmt: skip


def element_for(smallest: float) -> int:
    """Largest element that leaves a thing of this width alone [pixel]; 0 where none that is worth it does.

    Examples
    --------
    >>> element_for(16.0), element_for(8.0), element_for(4.0)
    (13, 5, 0)
    """
    size = int(min(ELEMENT_SHARE * smallest, LARGEST))
    size -= 1 - size % 2
    return size if size >= SMALLEST else 0


def coherence(
    blocks: Sequence[FloatArray], inside: Sequence[Mask], bands: Sequence[Band], nir: int, *, delayed: bool = False
) -> float | None:
    """How alike the NIR and the band that resembles it most are at small scales.

    Parameters
    ----------
    blocks : sequence of (band, row, column) ndarray
    inside : sequence of (row, column) bool ndarray
        Their pixels of water.
    bands : sequence of Band
    nir : int
        0-based NIR band.
    delayed : bool
        The bands are told to look one after the other: then the band that resembles it least counts. A few boats,
        bright in every band, and sparkle that lasts raise the largest correlation of such bands, the smallest less.

    Returns
    -------
    float or None
        Largest (or smallest) correlation, after the mean of `HIGH_PASS` pixels is taken off, with a band from 640 nm
        on (any band, where wavelengths are not known). None where there is no other band, or too little water.
    """
    import cv2

    known = all(b.wavelength for b in bands)
    others = [i for i, b in enumerate(bands) if i != nir and (not known or (b.wavelength or 0) >= 640)]
    others = others or [i for i in range(len(bands)) if i != nir]
    sums = np.zeros((len(others), 6))
    for block, mask in zip(blocks, inside, strict=True):
        high = {}
        for band in {nir, *others}:
            filled = np.where(np.isfinite(block[band]), block[band], np.float32(0)).astype(np.float32)
            high[band] = (filled - cv2.blur(filled, (HIGH_PASS, HIGH_PASS))).astype(np.float64)
        near = cv2.erode(
            (mask & np.isfinite(block).all(axis=0)).view(np.uint8), np.ones((HIGH_PASS, HIGH_PASS), np.uint8)
        )
        use = near.view(np.bool_)
        x = high[nir][use]
        for i, band in enumerate(others):
            y = high[band][use]
            sums[i] += [x.size, x.sum(), y.sum(), x @ x, y @ y, x @ y]
    if not len(others) or not sums[0, 0] > HIGH_PASS**2:
        return None
    n, sx, sy, sxx, syy, sxy = sums.T
    power = (sxx - sx * sx / n) * (syy - sy * sy / n)
    found = np.where(power > 0, (sxy - sx * sy / n) / np.sqrt(np.where(power > 0, power, 1)), 0.0)
    return float(found.min() if delayed else found.max())
