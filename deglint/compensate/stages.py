"""Chains of stages: their text form, fitting to a sample of a scene, application to blocks, saving and reading.

A chain is written as the names of its stages in order, some with a number: ``psf:2, identify-level:13, replace-level,
remove``. `remove` is the removal by the NIR; stages before it process the scene, stages after it process the result.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, asdict, dataclass
from itertools import takewhile
from typing import Any, ClassVar, Protocol, get_type_hints

import numpy as np

from ..checks import from_plain
from ..errors import InputError
from . import background, identify, median, normalise, posterior, replace_glint, targets
from .background import Background
from .identify import IdentifyMedian
from .median import Median
from .normalise import Normalise
from .posterior import Posterior
from .psf import PSF
from .replace_glint import ReplaceBands, ReplaceLevel
from .sharpen import Sharpen, SharpenImage
from .state import Sample, Setting, State, in_scene_units
from .targets import Targets


class Stage(Protocol):
    """A fitted stage: a frozen dataclass of plain numbers; `halo` is the margin it needs around a block [pixel]."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def halo(self) -> int: ...  # noqa: D102
    def apply(self, state: State) -> State: ...  # noqa: D102


@dataclass(frozen=True)
class Kind:
    """Definition of a stage, entry of `STAGES`: its fit function, its class, and the range of its number."""

    fit: Callable[[Sample, Setting, float | None], Stage] | None = None  # fits it, given its number; None for `remove`
    stage: type[Stage] | None = None  # class of the fitted stage
    low: float = 0.0  # least number that may be written after the name
    high: float = 0.0  # largest number; 0 for a stage without a number
    whole: bool = False  # the number must be an integer
    odd: bool = False  # the number must be an odd integer
    identifies: str = ""  # "glint", or "level" (glint, and the background that it exceeds)
    replaces: str = ""  # "glint" (identified), "level" (glint above the background), or "image", in every band


STAGES: dict[str, Kind] = {
    "normalise": Kind(normalise.fit, Normalise, 1, 100),  # by the median of deep water; its mode if glint covers > N %
    "psf": Kind(Sharpen.fit, Sharpen, 1, 20, whole=True),  # N iterations of Richardson-Lucy, for the background only
    "psf-image": Kind(SharpenImage.fit, SharpenImage, 1, 20, whole=True, replaces="image"),  # the result is the image
    "identify-median": Kind(identify.fit, IdentifyMedian, 0, 1000, identifies="glint"),  # N deviations above median
    "identify-level": Kind(background.fit, Background, 3, 255, odd=True, identifies="level"),  # opening, N pixels wide
    "replace-bands": Kind(replace_glint.fit_bands, ReplaceBands, replaces="glint"),  # from a band without glint
    "replace-level": Kind(lambda *_: ReplaceLevel(), ReplaceLevel, replaces="level"),  # from the band's own background
    "median": Kind(median.fit, Median, 3, 255, odd=True, replaces="glint"),  # adaptive median up to N pixels
    "targets": Kind(targets.fit, Targets, 1e-9, 0.1),  # small bright targets, at a false-alarm rate of N, restored
    "remove": Kind(),  # place of the removal by the NIR
    "posterior": Kind(posterior.fit, Posterior, 1, 64, whole=True),  # mean of the water; clumps of glint N pixels wide
}
THESIS_CHAIN = "normalise, identify-median:5, replace-bands, median:25, remove"
"""Chain of Fink (2014), section 6.3, without its PSF correction (`psf-image`), as far as it can be reconstructed."""
NEVER_AFTER = {
    ("normalise", "remove"): "normalise must come before remove: put normalise first, or leave normalise out.",
    ("normalise", "targets"): "targets needs values that are not normalised: leave out normalise.",
    ("remove", "remove"): "a chain has one remove: leave out the second remove.",
    ("replace-bands", "remove"): "replace-bands needs normalised bands: put replace-bands before remove.",
    ("targets", "remove"): "targets must come before the removal: put targets before remove.",
    ("targets", "normalise"): "targets needs values that are not normalised: leave out normalise.",
    ("targets", "median"): "median replaces targets: put targets before median.",
}  # (a stage, a stage that cannot come before it): why
ENDS_PSF = ("psf", "normalise", "replace-level", "median")  # like remove, they discard the result of `psf`


@dataclass(frozen=True)
class Step:
    """One stage as written in the text form of a chain: its name, and its number or None for the default number."""

    name: str
    number: float | None = None


@dataclass(frozen=True)
class Chain:
    """A fitted chain: the fitted stages before and after a removal."""

    before: tuple[Stage, ...] = ()  # stages before the removal
    after: tuple[Stage, ...] = ()  # stages after the removal
    text: str = ""  # text form of the chain

    @property
    def runs(self) -> bool:
        """Whether the chain has any stage, the removal not counted."""
        return bool(self.before or self.after)

    @property
    def replaces(self) -> bool:
        """Whether a stage may replace pixels also in bands that the removal does not correct."""
        return any(STAGES[stage.name].replaces for stage in (*self.before, *self.after))

    @property
    def halo(self) -> int:
        """Margin around a block that the stages need [pixel]; the removal needs `GlintModel.halo` in addition."""
        return sum(stage.halo for stage in (*self.before, *self.after))

    def numbers(self) -> dict[str, object]:
        """The fitted chain as a dictionary of plain values for JSON; `chain_from` reads it."""
        return {"chain": self.text, "before": [*map(plain, self.before)], "after": [*map(plain, self.after)]}


def parse(text: str) -> tuple[Step, ...]:
    """Parse the text form of a chain into steps; if "remove" is missing, it is added as the last step.

    Raises InputError for an unknown stage, a wrong number, a second "remove", or a stage at a wrong place (`_check`).

    >>> [step.name for step in parse("psf:2, identify-level:13, replace-level")]
    ['psf', 'identify-level', 'replace-level', 'remove']
    """
    steps = []
    for part in (p.strip() for p in text.split(",")):
        name, colon, number = part.partition(":")
        if name not in STAGES:
            raise InputError(f"stage {name!r} is not one of {', '.join(STAGES)}.")
        steps.append(Step(name, _number(name, number) if colon else None))
    names = [step.name for step in steps]
    _check(names)
    return tuple(steps) if "remove" in names else (*steps, Step("remove"))


def _number(name: str, text: str) -> float:
    """The number of stage `name`, read from `text`. Raises InputError if the stage does not accept this number."""
    kind = STAGES[name]
    if not kind.high:
        raise InputError(f"{name} takes no number, got {text!r}.")
    try:
        number = float(text)
    except ValueError:
        raise InputError(f"stage '{name}:{text}': {text!r} is not a number.") from None
    integer = kind.whole or kind.odd
    if not kind.low <= number <= kind.high or (integer and number % 1):
        noun = "an integer" if integer else "a number"
        raise InputError(f"{name} takes {noun} from {kind.low:g} to {kind.high:g}, got {text}.")
    if kind.odd and not number % 2:
        raise InputError(f"{name}:{text}: the size must be odd, so that it has a middle.")
    return number


def _check(names: Sequence[str]) -> None:
    """Raise InputError if a stage needs a missing stage before or after it, or `NEVER_AFTER` forbids the order."""
    ready: set[str] = set()  # what was identified (`Kind.identifies`) and is not replaced yet
    for place, name in enumerate(names):
        before, after = names[:place], names[place + 1 : [*names, "remove"].index("remove", place + 1)]
        for other in before:
            if (name, other) in NEVER_AFTER:
                raise InputError(NEVER_AFTER[name, other])
        if name == "psf" and "identify-level" not in takewhile(lambda n: n not in ENDS_PSF, after):
            raise InputError("psf needs identify-level right after psf; to sharpen the image itself, use psf-image.")
        if name == "posterior" and "remove" not in before:
            raise InputError("posterior works on the result of the removal: put posterior after remove.")
        if name == "targets" and "level" in ready and not {"replace-level", "median"} & set(after):
            raise InputError("targets after identify-level needs replace-level before remove: add replace-level.")
        if name == "replace-bands" and "normalise" not in before:
            raise InputError("replace-bands needs normalised bands: put normalise first.")
        needs = STAGES[name].replaces
        if needs in ("glint", "level") and not ready & {needs, "level"}:
            finders = [n for n, kind in STAGES.items() if kind.identifies in (needs, "level")]
            raise InputError(f"{name} needs identified glint: put {' or '.join(finders)} before {name}.")
        ready.add(STAGES[name].identifies)
        if name in ("replace-level", "median", "remove"):
            ready.clear()


def apply_stages(state: State, stages: Sequence[Stage]) -> State:
    """Apply fitted stages to a state in order; the result is in the unit of the scene."""
    for stage in stages:
        state = stage.apply(state)
    return in_scene_units(state)


def fit_stages(steps: Sequence[Step], sample: Sample, setting: Setting) -> tuple[tuple[Stage, ...], Sample]:
    """Fit each stage to the sample as it is after the stages before it; return the fitted stages, and the sample after
    them, in the unit of the scene. `steps` do not contain "remove"; `setting` has properties of the scene.

    Raises FitError if the sample does not allow a fit, and InputError if a stage needs data that `setting` lacks.
    """
    stages, states = [], sample.states
    for step in steps:
        fit = STAGES[step.name].fit
        assert fit is not None
        stages.append(fit(Sample(states, sample.inside), setting, step.number))
        states = tuple(stages[-1].apply(s) for s in states)
    return tuple(stages), Sample(tuple(map(in_scene_units, states)), sample.inside)


def plain(stage: Stage) -> dict[str, object]:
    """A fitted stage as plain values (JSON); each PSF is given as its kernel."""
    values = asdict(stage)
    if "psfs" in values:
        values["psfs"] = [p["kernel"].tolist() for p in values.pop("psfs")]
    return {"stage": stage.name, **values}


def _stage_from(data: Mapping[str, Any]) -> Stage:
    """Read a stage from the values that `plain` returns. Other values raise errors, which `chain_from` handles."""
    kind: Any = STAGES[data["stage"]].stage
    types, values = get_type_hints(kind), {k: _with_infinity(v) for k, v in data.items() if k != "stage"}
    if "psfs" in values:
        values["psfs"] = [PSF(np.array(k, np.float64)) for k in values["psfs"]]
    return kind(**{k: from_plain(types[k], v) for k, v in values.items()})


def chain_from(data: Mapping[str, Any]) -> Chain:
    """Read a chain from the values that `Chain.numbers` returns. Raises InputError if they are not a valid chain."""
    try:
        before, after = (tuple(_stage_from(s) for s in data[k]) for k in ("before", "after"))
        text = str(data["chain"])
        names = [*(s.name for s in before), "remove", *(s.name for s in after)]
        if names != [step.name for step in parse(text)]:
            raise ValueError(f"its stages are {', '.join(names)}, and its text is {text!r}")
        return Chain(before, after, text)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        why = f"there is no entry or stage {error}" if isinstance(error, KeyError) else error
        raise InputError(f"not a saved compensation ({why}); fit and save it again.") from error


def _with_infinity(value: object) -> Any:
    """A copy of a value, with lists instead of tuples, in which each None in a list (null in JSON) becomes infinity."""
    if isinstance(value, dict):
        return {k: _with_infinity(v) for k, v in value.items()}
    return [np.inf if v is None else _with_infinity(v) for v in value] if isinstance(value, (list, tuple)) else value
