"""Stages in a row: how a chain is written, fitted to a sample of a scene, and applied to its tiles.

A chain is written as its stages with what they take, in order: ``psf:2, identify-level:13, replace-level, remove,
identify-level:11, replace-level``. `remove` is where the removal of what the bands still share stands; the stages
before it see the scene, the stages after it what removal has left. Every stage is fitted on what the stages before it
made of the sample, and is then a frozen value of plain numbers."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar

import numpy as np

from ..errors import FitError, InputError
from ..scene import Band, FloatArray
from .evidence import Protection, protection_from
from .identify import FEWEST, THESIS_K, IdentifyLevel, IdentifyMedian, fit_identify_level, fit_identify_median
from .level import SMALLEST
from .match import Matching, apply_match, fit_match
from .median import Median
from .normalise import Normalise, fit_normalise
from .psf import PSF
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
    "match": "blur every band as the longest is blurred, for bands of one instant",
    "identify-median": "glint is above median + K lower-side deviations",
    "identify-level": "glint is above the opened level (element of N pixels)",
    "replace-bands": "from the spectrally nearest clean band",
    "replace-level": "from the band's own opened level",
    "median": "adaptive median up to N pixels where glint is left",
    "remove": "where the removal by the NIR stands",
}
THESIS = "normalise, identify-median:5, replace-bands, median:25, remove"
"""Section 6.3 of the thesis, as far as it can be reconstructed."""
RANGES: dict[str, tuple[float, float]] = {
    "normalise": (1, 100), "psf": (1, 20), "psf-image": (1, 20), "identify-median": (0, 1000),
    "identify-level": (3, 255), "median": (3, 255),
}  # fmt: skip
"""What the numbers of the stages may be; stages that are not named take none."""
WHOLE = ("psf", "psf-image", "identify-level", "median")
"""Stages that take whole numbers."""
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
            source, sound = state.image, state.sound
            state.sharp = lambda b, at: richardson_lucy(
                source[b], self.psfs[b], iterations=self.iterations, within=at, sound=sound
            )
            state.psfs = self.psfs
            return
        for b, (band, psf) in enumerate(zip(state.image, self.psfs, strict=True)):
            may = np.isfinite(band) if state.where is None else np.isfinite(band) & state.where
            np.copyto(band, richardson_lucy(band, psf, iterations=self.iterations), where=may)
            state.replaced[b] |= may


@dataclass(frozen=True)
class Match:
    """OTF matching: every band is blurred as the longest is, so that removal sees the same sparkle in all.

    Attributes
    ----------
    matching : Matching
        Kernels; see `deglint.compensate.match`.
    """

    matching: Matching
    name: ClassVar[str] = "match"

    @property
    def halo(self) -> int:
        """Radius of the kernels."""
        return self.matching.halo

    def apply(self, state: State) -> None:
        """Blur the bands."""
        state.image[...] = apply_match(state.image, self.matching)
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
    def runs(self) -> bool:
        """There are stages at all."""
        return bool(self.before or self.after)

    @property
    def in_place(self) -> bool:
        """The stages before the removal keep the scene's unit, so that they may work on the block itself."""
        return not any(isinstance(stage, Normalise) for stage in self.before)

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
        name, colon, number = part.partition(":")
        if name not in STAGES:
            raise InputError(f"stage {name!r} is not one of {', '.join(STAGES)}.")
        steps.append(Step(name, _number(name, number) if colon else None))
    if sum(s.name == "remove" for s in steps) > 1:
        raise InputError("a chain removes once; name other stages before and after it.")
    _check(steps)
    if not any(s.name == "remove" for s in steps):
        steps.append(Step("remove"))
    return tuple(steps)


def _number(name: str, text: str) -> float:
    """The number of a stage, from its text."""
    if name not in RANGES:
        raise InputError(f"{name} takes no number, got {text!r}.")
    try:
        number = float(text)
    except ValueError:
        raise InputError(f"stage '{name}:{text}': {text!r} is not a number.") from None
    low, high = RANGES[name]
    if not low <= number <= high or (name in WHOLE and number % 1):
        raise InputError(f"{name} takes a {'whole ' * (name in WHOLE)}number from {low:g} to {high:g}, got {text}.")
    if name in ("identify-level", "median") and not number % 2:
        raise InputError(f"{name}:{text}: the size must be odd, so that it has a middle.")
    return number


def _check(steps: Sequence[Step]) -> None:
    ready: set[str] = set()
    for place, step in enumerate(steps):
        after = [s.name for s in steps[place + 1 :]]
        if step.name == "psf" and "identify-level" not in after[: after.index("remove") if "remove" in after else None]:
            raise InputError("psf serves identify-level: name that after it, or psf-image to sharpen the image itself.")
        if step.name == "replace-bands" and "normalise" not in [s.name for s in steps[:place]]:
            raise InputError("replace-bands needs bands of one scale: name normalise at the beginning.")
        if step.name in ("replace-bands", "median") and "hit" not in ready:
            raise InputError(
                f"{step.name} needs glint to be identified: name identify-median or identify-level before it."
            )
        if step.name == "replace-level" and "level" not in ready:
            raise InputError("replace-level needs a level: name identify-level before it.")
        if step.name.startswith("identify"):
            ready |= {"hit"} | ({"level"} if step.name == "identify-level" else set())
        if step.name in ("replace-level", "median", "remove"):
            ready.clear()


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
        Bands see the sea at different instants, so that outlines may be told from sparkle.
    floor : tuple of float, optional
        Least standard deviation of pixels without glint, of each band: what is known of the noise and the steps.
    steps : tuple of float, optional
        Of each band's numbers, where those are whole numbers in the file.
    """

    bands: tuple[Band, ...]
    psfs: tuple[PSF, ...] | None = None
    detail: bool = False
    floor: tuple[float, ...] | None = None
    steps: tuple[float, ...] | None = None

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
    each: Callable[..., Iterable[Any]] = map,
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
    each : callable
        What works on the blocks: `map`, or the map of a pool of threads.

    Raises
    ------
    FitError, InputError
        The sample is too small, or a stage lacks what it needs.
    """
    fitted = []
    for step in steps:
        stage = _fit_stage(step, sample, setting, bands, each)
        deque(each(stage.apply, sample.states), maxlen=0)
        fitted.append(stage)
    return tuple(fitted)


def _fit_stage(step: Step, sample: Sample, setting: Setting, bands: Any, each: Callable[..., Iterable[Any]]) -> Stage:
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
    if step.name == "match":
        if setting.psfs is None:
            raise InputError("match needs the sensor's optics, which are not known. Name a --sensor, or leave it out.")
        return Match(fit_match(setting.psfs, setting.order[-1]))
    if step.name == "identify-median":
        k = THESIS_K if step.number is None else step.number
        return fit_identify_median(sample.values(), setting.saturation, k=k, floor=floor)
    if step.name == "identify-level":
        size = size or 13
        detail = size if setting.detail and size >= SMALLEST else 0
        return fit_identify_level(
            sample.states, sample.inside, size=size, order=setting.order, saturation=setting.saturation,
            detail=detail, bands=bands, floor=floor, steps=steps, each=each,
        )  # fmt: skip
    if step.name == "replace-bands":
        return ReplaceBands(neighbours([b.wavelength for b in setting.bands]))
    return ReplaceLevel() if step.name == "replace-level" else Median(size or 25)


def apply_stages(state: State, stages: Sequence[Stage], cut: tuple[int, int, int, int] = (0, 0, 0, 0)) -> State:
    """Work on a block, in place where nothing is cut off.

    Parameters
    ----------
    state : State
        The block with its halo.
    stages : sequence of stages
    cut : (int, int, int, int)
        Rows above and below, columns left and right, that are no part of the result. Stages need not work on what the
        stages after them do not look at.
    """
    reach = sum(stage.halo for stage in stages)
    pending, done = 0, [0, 0, 0, 0]
    for stage in stages:
        reach -= stage.halo
        promised = isinstance(stage, Sharpen) and not stage.image  # it looks around when the level is built
        pending = pending + stage.halo if promised else pending
        if isinstance(stage, IdentifyLevel):
            pending = 0
        spare = [max(n - reach - pending, 0) for n in cut]
        a, b, c, d = (now - before for now, before in zip(spare, done, strict=True))
        state.spare, done = (a, b, c, d), spare
        if not isinstance(stage, ReplaceLevel):
            state.mark()
        stage.apply(state)
        state.cut()
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
    if isinstance(stage, Match):
        kernels = [None if k is None else k.tolist() for k in stage.matching.kernels]
        residual = list(stage.matching.residual)
        return {"stage": stage.name, "kernels": kernels, "reference": stage.matching.reference, "residual": residual}
    found = asdict(stage)
    if "saturation" in found:  # JSON knows no infinity
        found["saturation"] = tuple(s if np.isfinite(s) else None for s in found["saturation"])
    return {"stage": stage.name, **found}


def stage_from(data: Mapping[str, Any]) -> Stage:
    """Read back what `Chain.numbers` says of a stage.

    Raises
    ------
    InputError
        Not a stage of this version.
    """
    kinds = {k.name: k for k in (Normalise, IdentifyMedian, IdentifyLevel, ReplaceBands, ReplaceLevel, Median)}
    rest = {k: _tuples(v) for k, v in data.items() if k != "stage"}
    if "saturation" in rest:
        rest["saturation"] = tuple(np.inf if s is None else s for s in rest["saturation"])
    try:
        name = data["stage"]
        if name in ("psf", "psf-image"):
            psfs = tuple(PSF(np.array(k, np.float64), len(k) // 2) for k in data["kernels"])
            return Sharpen(psfs, int(data["iterations"]), name == "psf-image")
        if name == "match":
            matched = tuple(None if k is None else np.array(k) for k in data["kernels"])
            return Match(Matching(matched, int(data["reference"]), tuple(data["residual"])))
        return kinds[name](**rest)
    except (KeyError, TypeError, ValueError) as error:
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
