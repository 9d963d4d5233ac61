"""Stages in a row: how a chain is written, fitted to a sample of a scene, and applied to its tiles.

A chain is written as its stages with what they take, in order: ``psf:2, identify-level:13, replace-level, remove,
identify-level:11, replace-level``. `remove` is where the removal of what the bands still share stands; the stages
before it see the scene, the stages after it what removal has left. Every stage is fitted on what the stages before it
made of the sample, and is then a frozen value of plain numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from ..errors import InputError
from ..scene import Band, FloatArray
from .evidence import Protection, protection_from
from .identify import THESIS_K, IdentifyLevel, IdentifyMedian, fit_identify_level, fit_identify_median
from .median import Median
from .normalise import Normalise, fit_normalise
from .psf import PSF, kernel_psf
from .reference import ReferenceRule
from .register import Move
from .replace import ReplaceBands, ReplaceLevel, neighbours
from .sharpen import richardson_lucy, sharpen_halo
from .state import Mask, State

Stage = Any
"""One of the fitted stages: `apply(state)`, `halo`, `name`."""
STAGES: dict[str, str] = {
    "normalise": "divide by the median of deep water; by its mode where glint covers more than N %",
    "psf": "N iterations of Richardson-Lucy, to build the level only",
    "psf-image": "N iterations of Richardson-Lucy, as the image itself",
    "identify-median": "glint is above median + K lower-side deviations",
    "identify-level": "glint is above the opened level (element of N pixels)",
    "replace-bands": "from the spectrally nearest clean band",
    "replace-level": "from the band's own opened level",
    "median": "adaptive median up to N pixels where glint is left",
    "remove": "where the removal by the NIR stands",
}
THESIS = "normalise, identify-median:5, replace-bands, median:25, remove"
"""Section 6.3 of the thesis, as far as it can be reconstructed."""
NO_STAGES = "no opening, so no small thing is erased"
ITERATIONS = 2
"""Richardson-Lucy iterations; more dig pits beside sparkle, which the opening then spreads."""


@dataclass(frozen=True)
class Sharpen:
    """The PSF stage: Richardson-Lucy with the PSF of each band.

    Attributes
    ----------
    psfs : tuple of PSF
    iterations : int
    image : bool
        The sharpened bands replace the image (as in the thesis); else they serve to build the level.
    """

    psfs: tuple[PSF, ...]
    iterations: int
    image: bool = False

    @property
    def name(self) -> str:
        """As in a chain."""
        return "psf-image" if self.image else "psf"

    @property
    def halo(self) -> int:
        """Reach of the iterations, and of blurring the level again."""
        return max(sharpen_halo(p, self.iterations) + (0 if self.image else p.radius) for p in self.psfs)

    def apply(self, state: State) -> None:
        """Sharpen every band, or promise to do so, one at a time, when the level is built."""
        if not self.image:
            source, psfs, iterations = state.image, self.psfs, self.iterations
            state.sharp = lambda b: richardson_lucy(source[b], psfs[b], iterations=iterations)
            state.psfs = self.psfs
            return
        sharp = [richardson_lucy(b, p, iterations=self.iterations) for b, p in zip(state.image, self.psfs, strict=True)]
        state.image[...] = np.stack(sharp)
        state.replaced[...] = True if state.where is None else state.where


@dataclass(frozen=True)
class Chain:
    """A fitted chain.

    Attributes
    ----------
    before, after : tuple of stages
        Before and after the removal.
    text : str
        How it is written.
    references : tuple of (int, ReferenceRule)
        0-based NIR bands that the removal is not to follow where they stand out from the water around, and how far.
    moves : tuple of Move
        NIR bands that are moved for a band to follow.
    protection : Protection
        How small things are told from sparkle, and put back.
    """

    before: tuple[Stage, ...] = ()
    after: tuple[Stage, ...] = ()
    text: str = ""
    references: tuple[tuple[int, ReferenceRule], ...] = ()
    moves: tuple[Move, ...] = ()
    protection: Protection = field(default_factory=lambda: Protection(reason=NO_STAGES))

    @property
    def halo(self) -> int:
        """Pixels around a tile that the chain looks at."""
        return self.halo_before + self.halo_after

    @property
    def halo_before(self) -> int:
        """Of the stages before the removal."""
        return sum(stage.halo for stage in self.before)

    @property
    def halo_after(self) -> int:
        """Of the stages after it."""
        return sum(stage.halo for stage in self.after)

    def numbers(self) -> dict[str, Any]:
        """What was fitted, for the sidecar."""
        return {
            "chain": self.text,
            "before": [_plain(s) for s in self.before],
            "after": [_plain(s) for s in self.after],
            "references": [{"band": band, **asdict(rule)} for band, rule in self.references],
            "moves": [asdict(m) for m in self.moves],
            "protection": self.protection.numbers(),
        }

    def saved(self) -> dict[str, Any]:
        """The same with the tables of the protection, to be read back by `chain_from`."""
        return self.numbers() | {"protection": self.protection.saved()}


@dataclass(frozen=True)
class Step:
    """One stage as written: its name and number."""

    name: str
    number: float | None = None


def parse(text: str) -> tuple[Step, ...]:
    """Read a chain as it is written.

    Raises
    ------
    InputError
        An unknown stage, or a number where none is taken, or none where one is needed.

    Examples
    --------
    >>> [step.name for step in parse("psf:2, identify-level:13, replace-level")]
    ['psf', 'identify-level', 'replace-level', 'remove']
    """
    steps = []
    for part in (p.strip() for p in text.split(",")):
        name, _, number = part.partition(":")
        if name not in STAGES:
            raise InputError(f"stage {name!r} is not one of {', '.join(STAGES)}.")
        try:
            steps.append(Step(name, float(number) if number else None))
        except ValueError:
            raise InputError(f"stage {part!r}: {number!r} is not a number.") from None
    if sum(s.name == "remove" for s in steps) > 1:
        raise InputError("a chain removes once; name other stages before and after it.")
    _check(steps)
    if not any(s.name == "remove" for s in steps):
        steps.append(Step("remove"))
    return tuple(steps)


def _check(steps: Sequence[Step]) -> None:
    ready: set[str] = set()
    for step in steps:
        if (
            step.name in ("identify-level", "median")
            and step.number is not None
            and (step.number < 3 or not step.number % 2)
        ):
            raise InputError(f"{step.name}:{step.number:g}: the size must be odd and 3 or more.")
        if step.name in ("replace-bands", "median") and "hit" not in ready:
            raise InputError(
                f"{step.name} needs glint to be identified: name identify-median or identify-level before it."
            )
        if step.name == "replace-level" and "level" not in ready:
            raise InputError("replace-level needs a level: name identify-level before it.")
        if step.name.startswith("identify"):
            ready |= {"hit"} | ({"level"} if step.name == "identify-level" else set())
        if step.name in ("replace-level", "median"):
            ready.clear()


@dataclass(frozen=True, eq=False)
class Sample:
    """Blocks of a scene with their halos, in physical values, and which of their pixels are deep water."""

    states: list[State]
    inside: list[Mask]

    def values(self) -> list[Any]:
        """The sample's pixels, one array a band."""
        bands = range(len(self.states[0].image))
        out = [np.concatenate([s.image[b][m] for s, m in zip(self.states, self.inside, strict=True)]) for b in bands]
        return [v[np.isfinite(v)] for v in out]


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
        Bands see the sea at different instants, so that outlines may be told from sparkle.
    floor : tuple of float, optional
        Least standard deviation of pixels without glint, of each band: what is known of the noise and the steps.
    """

    bands: tuple[Band, ...]
    psfs: tuple[PSF, ...] | None = None
    detail: bool = False
    floor: tuple[float, ...] | None = None

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
) -> tuple[Stage, ...]:
    """Fit stages to a sample, each on what the one before it made; the sample's images are worked on in place.

    Parameters
    ----------
    steps : sequence of Step
        No `remove` among them.
    sample : Sample
    setting : Setting
    bands : sequence of int, optional
        Bands that `identify-level` looks at; all by default.

    Raises
    ------
    FitError, InputError
        The sample is too small, or a stage lacks what it needs.
    """
    fitted = []
    for step in steps:
        stage = _fit_stage(step, sample, setting, bands)
        for state in sample.states:
            stage.apply(state)
        fitted.append(stage)
    return tuple(fitted)


def _fit_stage(step: Step, sample: Sample, setting: Setting, bands: Any) -> Stage:
    size = int(step.number or 0)
    floor = (
        None if setting.floor is None else [f / u for f, u in zip(setting.floor, sample.states[0].units, strict=True)]
    )
    if step.name == "normalise":
        return fit_normalise(sample.values(), most_cover=0.01 * (step.number or 100.0))
    if step.name in ("psf", "psf-image"):
        if setting.psfs is None:
            raise InputError(
                f"{step.name} needs the sensor's optics, which are not known. Name a --sensor, or leave it out."
            )
        return Sharpen(setting.psfs, size or ITERATIONS, step.name == "psf-image")
    if step.name == "identify-median":
        return fit_identify_median(sample.values(), setting.saturation, k=step.number or THESIS_K, floor=floor)
    if step.name == "identify-level":
        size = size or 13
        detail = size - 2 if setting.detail and size >= 5 else 0
        return fit_identify_level(
            sample.states, sample.inside, size=size, order=setting.order, saturation=setting.saturation,
            detail=detail, bands=bands, floor=floor,
        )  # fmt: skip
    if step.name == "replace-bands":
        return ReplaceBands(neighbours([b.wavelength for b in setting.bands]))
    return ReplaceLevel() if step.name == "replace-level" else Median(size or 25)


def apply_stages(state: State, stages: Sequence[Stage]) -> State:
    """Work on a block, in place.

    Parameters
    ----------
    state : State
        The block with its halo.
    stages : sequence of stages
    """
    for stage in stages:
        stage.apply(state)
    return state


def finish(state: State, block: FloatArray) -> FloatArray:
    """Bring a state back into the scene's unit: what was not replaced is the block's own, to the bit.

    Returns
    -------
    (band, row, column) ndarray
        Of the block's type.
    """
    if block.dtype == np.float32 and (state.units == 1).all():
        return state.image  # only what was replaced differs
    out = block.copy()
    for b, unit in enumerate(state.units):
        values = state.image[b] if unit == 1 else state.image[b] * np.float32(unit)
        np.copyto(out[b], values, where=state.replaced[b], casting="same_kind")
    return out


def _plain(stage: Stage) -> dict[str, Any]:
    """A stage as plain numbers."""
    if isinstance(stage, Sharpen):
        kernels = [p.kernel.tolist() for p in stage.psfs]
        return {"stage": stage.name, "iterations": stage.iterations, "kernels": kernels}
    return {"stage": stage.name, **asdict(stage)}


def stage_from(data: Mapping[str, Any]) -> Stage:
    """Read back what `Chain.numbers` says of a stage.

    Raises
    ------
    InputError
        Not a stage of this version.
    """
    kinds = {k.name: k for k in (Normalise, IdentifyMedian, IdentifyLevel, ReplaceBands, ReplaceLevel, Median)}
    rest = {k: _tuples(v) for k, v in data.items() if k != "stage"}
    try:
        name = data["stage"]
        if name in ("psf", "psf-image"):
            psfs = tuple(kernel_psf(np.array(k)) for k in data["kernels"])
            return Sharpen(psfs, int(data["iterations"]), name == "psf-image")
        return kinds[name](**rest)
    except (KeyError, TypeError) as error:
        raise InputError(f"not a saved stage of a compensation ({error}); fit and save it again.") from error


def chain_from(data: Mapping[str, Any]) -> Chain:
    """Read back what `Chain.numbers` says.

    Raises
    ------
    InputError
        Not a chain of this version.
    """
    try:
        before, after = (tuple(stage_from(s) for s in data[k]) for k in ("before", "after"))
        rules = [dict(r) for r in data["references"]]
        references = tuple((int(r.pop("band")), ReferenceRule(**r)) for r in rules)
        moves = tuple(Move(**m) for m in data["moves"])
        return Chain(before, after, str(data["chain"]), references, moves, protection_from(data["protection"]))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"not a saved compensation ({error}); fit and save it again.") from error


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value
