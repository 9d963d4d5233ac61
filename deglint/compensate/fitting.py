"""Fit the stages of a chain to a sample: each on what the stages before it made of it, and no more of that than is
looked at."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ..errors import FitError, InputError
from ..scene import Band, Window
from .chain import ITERATIONS, Crop, Sharpen, Stage, Step, run, spares
from .identify import FEWEST, THESIS_K, fit_identify_level, fit_identify_median
from .level import SMALLEST
from .median import Median
from .normalise import fit_normalise
from .opening import opening_halo
from .psf import PSF
from .replace import ReplaceBands, ReplaceLevel, neighbours
from .state import Float32Array, Mask, State

ELEMENT, REACH = 13, 25
"""Element of the opening, and largest window of the median, where a chain names none [pixel]."""
LOOKING = "normalise", "identify-median", "identify-level"
"""Stages that look at the sample to be fitted."""
Each = Callable[..., Iterable[Any]]


@dataclass(frozen=True, eq=False)
class Sample:
    """Blocks of a scene with their halos, in physical values, and which of their pixels are deep water."""

    states: list[State]
    inside: list[Mask]

    def values(self) -> list[Any]:
        """The sample's pixels, one array a band.

        Raises
        ------
        FitError
            There are too few.
        """
        bands = range(len(self.states[0].image))
        out = [np.concatenate([s.image[b][m] for s, m in zip(self.states, self.inside, strict=True)]) for b in bands]
        out = [v[np.isfinite(v)] for v in out]
        least = min(v.size for v in out)
        if least < FEWEST:
            raise FitError(f"sample holds {least} valid pixels of a band, need at least {FEWEST}. Widen the --sample.")
        return out


@dataclass(frozen=True)
class Setting:
    """What a chain needs to know of the scene to be fitted.

    Attributes
    ----------
    bands : tuple of Band
        Of the scene.
    psfs : tuple of PSF, optional
        Of the bands, where the optics are known.
    detail : bool
        It is known at what instants bands see the sea, so that outlines may be told from sparkle.
    floor : tuple of float, optional
        Least standard deviation of pixels without glint, of each band: what is known of the noise and the steps.
    steps : tuple of float, optional
        Of each band's numbers, where those are whole numbers in the file.
    nir : int, optional
        The NIR, where `identify-level` is to tell glint from other bright things.
    cover : float
        Share of glinted pixels in the middlemost band, before any was replaced, where that is known.
    witness : int, optional
        The NIR, where bands see the sea at one instant: it shows glint wherever another does.
    """

    bands: tuple[Band, ...]
    psfs: tuple[PSF, ...] | None = None
    detail: bool = False
    floor: tuple[float, ...] | None = None
    steps: tuple[float, ...] | None = None
    nir: int | None = None
    cover: float = 0.0
    witness: int | None = None

    @property
    def saturation(self) -> tuple[float, ...]:
        """Of each band; infinity where not known."""
        return tuple(np.inf if b.saturation is None else b.saturation for b in self.bands)

    @property
    def order(self) -> tuple[int, ...]:
        """Bands by wavelength, or as they stand in the file where a wavelength is not known."""
        if any(b.wavelength is None for b in self.bands):
            return tuple(range(len(self.bands)))
        return tuple(sorted(range(len(self.bands)), key=lambda i: (self.bands[i].wavelength or 0.0, i)))


def fit_stages(
    steps: Sequence[Step],
    sample: Sample,
    setting: Setting,
    *,
    bands: Sequence[int] | None = None,
    left: Sequence[int] = (),
    each: Each = map,
    cuts: Sequence[Crop] | None = (),
) -> tuple[Stage, ...]:
    """Fit stages to a sample, each on what the one before it made; the sample's images are worked on in place.

    Parameters
    ----------
    steps : sequence of Step
        No `remove` among them.
    sample : Sample
    setting : Setting
    bands : sequence of int, optional
        Bands that `identify-level` finds glint in; all by default.
    left : sequence of int
        Others whose outlines it compares with theirs.
    each : callable
        What works on the blocks: `map`, or the map of a pool of threads.
    cuts : sequence of (int, int, int, int), or None
        Rows above and below, columns left and right, of each block's halo that are not wanted in the end: they are
        cut off the sample as soon as no stage looks at them. Nothing is by default. None: the images are not wanted at
        all, and are left as they are where no further stage is fitted to them.

    Raises
    ------
    FitError, InputError
        The sample is too small, or a stage lacks what it needs.
    """
    reaches = [(step.name, reach_of(step, setting.psfs)) for step in steps]
    applied = len(steps) if cuts is not None else max((i for i, s in enumerate(steps) if s.name in LOOKING), default=0)
    spare = [spares(reaches, cut) for cut in cuts or [(0, 0, 0, 0)] * len(sample.states)]
    fitted = []
    for i, step in enumerate(steps):
        for state, following in zip(sample.states, spare, strict=True):
            state.spare = next(following)
        once = _sharpened_once(step, sample, setting) if i < applied else []
        stage = _fit_stage(step, sample, setting, bands, left, each)
        fitted.append(stage)
        if i < applied:
            inner = [s.inner() for s in sample.states]
            deque(each(partial(run, stage), sample.states), maxlen=0)
            sample.inside[:] = [m[slice(*r), slice(*c)] for m, (r, c) in zip(sample.inside, inner, strict=True)]
        for sharp in once:
            sharp.forget()
    return tuple(fitted)


def reach_of(step: Step, psfs: Sequence[PSF] | None) -> int:
    """Pixels around a tile that a stage will look at, at most, once it is fitted."""
    size = int(step.number or 0)
    if step.name in ("psf", "psf-image") and psfs:
        return Sharpen(tuple(psfs), size or ITERATIONS, step.name == "psf-image").halo
    if step.name == "identify-level":
        return opening_halo(size or ELEMENT, size or ELEMENT)
    return Median(size or REACH).halo if step.name == "median" else 0


class _Once:
    """Sharpened bands of a block, each worked out when it is first asked for, and kept."""

    def __init__(self, state: State, window: Window) -> None:
        assert state.sharp is not None
        self.sharp, self.window, self.kept = state.sharp, window, dict[int, Float32Array]()
        state.sharp = self

    def __call__(self, band: int, at: Window) -> Float32Array:
        """Rows and columns of a band."""
        if self.window == ((0, 0), (0, 0)):
            return self.sharp(band, at)
        if band not in self.kept:
            self.kept[band] = self.sharp(band, self.window)
        rows, columns = (slice(a - low, b - low) for (a, b), (low, _) in zip(at, self.window, strict=True))
        return np.ascontiguousarray(self.kept[band][rows, columns])

    def forget(self) -> None:
        """What is sharpened has changed."""
        self.window = (0, 0), (0, 0)
        self.kept.clear()


def _sharpened_once(step: Step, sample: Sample, setting: Setting) -> list[_Once]:
    """Sharpen once what the level is fitted to and what it is then made of, where that asks for it."""
    if step.name != "identify-level" or setting.psfs is None or sample.states[0].sharp is None:
        return []
    beside = 0 if setting.witness is None else int(step.number or ELEMENT) // 2  # that a witness is looked at
    reach = reach_of(step, None) + max(p.radius for p in setting.psfs) + beside
    return [_Once(s, s.inner(reach)) for s in sample.states]


def _fit_stage(step: Step, sample: Sample, setting: Setting, bands: Any, left: Any, each: Each) -> Stage:
    size = int(step.number or 0)
    units = sample.states[0].units
    floor, steps = (None if known is None else list(known / units) for known in (setting.floor, setting.steps))
    if step.name == "normalise":
        return fit_normalise(sample.values(), most_cover=0.01 * (step.number or 100.0))
    if step.name in ("psf", "psf-image"):
        if setting.psfs is None:
            raise InputError(
                f"{step.name} needs the sensor's optics, which are not known. Name a --sensor, or leave it out."
            )
        return Sharpen(setting.psfs, size or ITERATIONS, step.name == "psf-image")
    if step.name == "identify-median":
        k = THESIS_K if step.number is None else step.number
        return fit_identify_median(sample.values(), setting.saturation, k=k, floor=floor)
    if step.name == "identify-level":
        size = size or ELEMENT
        detail = size if setting.detail and size >= SMALLEST else 0
        return fit_identify_level(
            sample.states, sample.inside, size=size, order=setting.order, saturation=setting.saturation,
            detail=detail, bands=bands, left=left, floor=floor, steps=steps, nir=setting.nir,
            witness=setting.witness, cover_before=setting.cover, each=each,
        )  # fmt: skip
    if step.name == "replace-bands":
        return ReplaceBands(neighbours([b.wavelength for b in setting.bands]))
    return ReplaceLevel() if step.name == "replace-level" else Median(size or REACH)
