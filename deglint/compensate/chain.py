"""Stages in a row: how a chain is written, fitted to a sample of a scene, and applied to its tiles.

A chain is written as its stages with what they take, in order: ``psf:2, identify-level:13, replace-level, remove,
identify-level:11, replace-level``. `remove` is where the removal of what the bands still share stands; the stages
before it see the scene, the stages after it what removal has left. Every stage is fitted on what the stages before it
made of the sample, and is then a frozen value of plain numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from ..errors import InputError
from ..scene import FloatArray
from .evidence import Protection, protection_from
from .identify import IdentifyLevel, IdentifyMedian
from .median import Median
from .noise import Spread
from .normalise import Normalise
from .presence import Presence, presence_from
from .psf import PSF
from .replace import ReplaceBands, ReplaceLevel
from .sharpen import richardson_lucy, sharpen_halo
from .state import State

Stage = Any
"""One of the fitted stages: `apply(state)`, `halo`, `name`."""
Crop = tuple[int, int, int, int]
"""Rows above and below, columns left and right."""
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
RANGES: dict[str, tuple[float, float]] = {
    "normalise": (1, 100), "psf": (1, 20), "psf-image": (1, 20), "identify-median": (0, 1000),
    "identify-level": (3, 255), "median": (3, 255),
}  # fmt: skip
"""What the numbers of the stages may be; stages that are not named take none."""
WHOLE = ("psf", "psf-image", "identify-level", "median")
"""Stages that take whole numbers."""
READERS = ("psf", "identify-median", "identify-level", "replace-level")
"""Stages that do not write into the image, or see to it themselves that they may."""
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
class Chain:
    """A fitted chain.

    Attributes
    ----------
    before, after : tuple of stages
        Before and after the removal.
    text : str
        How it is written.
    protection : Protection
        How small things are told from sparkle, and put back.
    presence : Presence, optional
        Where there is glint to compensate and to remove; everywhere without it.
    """

    before: tuple[Stage, ...] = ()
    after: tuple[Stage, ...] = ()
    text: str = ""
    protection: Protection = field(default_factory=lambda: Protection(reason=NO_STAGES))
    presence: Presence | None = None

    @property
    def runs(self) -> bool:
        """There are stages at all."""
        return bool(self.before or self.after)

    @property
    def in_place(self) -> bool:
        """The stages before the removal keep the scene's unit, so that they may work on the block itself."""
        return not any(isinstance(stage, Normalise) for stage in self.before)

    @property
    def spreads(self) -> list[Spread]:
        """How pixels without glint lie about their level, of the bands that are opened before the removal."""
        opened = [stage for stage in self.before if isinstance(stage, IdentifyLevel)]
        return opened[-1].spreads if opened else []

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
            "protection": self.protection.numbers(),
            "presence": None if self.presence is None else self.presence.numbers(),
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


def apply_stages(state: State, stages: Sequence[Stage], cut: Crop = (0, 0, 0, 0)) -> State:
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
    for stage, spare in zip(stages, spares([(s.name, s.halo) for s in stages], cut), strict=True):
        state.spare = spare
        run(stage, state)
    return state


def run(stage: Stage, state: State) -> None:
    """Apply one stage, and cut off what no other will look at."""
    if not isinstance(stage, ReplaceLevel):
        state.mark()
    if stage.name not in READERS:
        state.take()
    stage.apply(state)
    state.cut()


def spares(stages: Sequence[tuple[str, int]], cut: Crop) -> Iterator[Crop]:
    """What may be cut off after each of some stages, of which the names and halos are given."""
    reach = sum(halo for _name, halo in stages)
    pending, done = 0, [0, 0, 0, 0]
    for place, (name, halo) in enumerate(stages):
        reach -= halo
        if name == "psf":  # it looks around when a level is built, and may do so until glint is replaced
            pending += halo
        elif name == IdentifyLevel.name and (stages[place + 1 :] or [("", 0)])[0][0] != name:
            pending = 0
        spare = [max(n - reach - pending, 0) for n in cut]
        a, b, c, d = (now - before for now, before in zip(spare, done, strict=True))
        done = spare
        yield a, b, c, d


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
        if data.get("references") or data.get("moves"):
            raise InputError("a saved model of an earlier version, whose NIR is moved: fit and save it again.")
        protection, told = protection_from(data["protection"]), data.get("presence")
        presence = presence_from(told) if told else None
        return Chain(before, after, str(data["chain"]), protection, presence)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"not a saved compensation ({error}); fit and save it again.") from error


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value
