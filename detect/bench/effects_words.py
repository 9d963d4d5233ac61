"""What single effects of the sensor do, in words; every figure is computed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from . import simulated
from .measure import percent
from .section import Number, over_seeds

if TYPE_CHECKING:
    from .effects import Effect, Found

SAID = {"raw": "raw", "joyce": "Joyce alone", "default": "removal by default"}
LEAST = 0.001
"""Loss of area that is worth a word."""
DIM = 0
"""Number of the kind of object that the words speak of: the hardest to find."""


def opening(seeds: int) -> tuple[str, ...]:
    """What was done, and how it is measured."""
    from .effects import WIND

    made = (
        f"One sea a seed ({seeds} of them, {WIND:g} m/s, {simulated.SKY} sky, {simulated.SIDE} x {simulated.SIDE} "
        "pixels, seen from above) by sensors that differ from an ideal one in a single thing. The ideal one: f/2, no "
        "smear, all bands at one instant, 16 bits and so many electrons that noise does not show. Error and objects as "
        "in the chapters before. Every error is against the truth through the same optics: blur is no error by itself."
    )
    noise = (
        "The usual noise is that of the thesis' sensor: 100 000 electrons at full scale, 12 of read noise, 12 bits. "
        "Twice that is shot noise twice as large for its signal, and read noise twice as large for its well."
    )
    return made, noise


def finding(found: Found) -> str:
    """The chapter in a sentence."""
    from .effects import EFFECTS

    text = []
    for state in ("joyce", "default"):
        rise = {}
        for effect in EFFECTS:
            levels = effect.chosen(found.quick)
            rise[effect] = found.change((effect.name, levels[-1]), (effect.name, levels[0]), state).value
        worst = max(rise, key=lambda e: rise[e])
        levels = worst.chosen(found.quick)
        before, after = (found.error((worst.name, level), state).value for level in (levels[0], levels[-1]))
        text.append(f"{SAID[state]} suffers most from {worst.title.lower()} ({worst.said(levels[-1])}: "
                    f"{percent(before)} becomes {percent(after)})")  # fmt: skip
    return f"Of the sensor's effects alone, {', '.join(text)}."


def of_effect(found: Found, effect: Effect) -> tuple[str, ...]:
    """What an effect does to error and detection, and where removal hurts."""
    levels = effect.chosen(found.quick)
    first, last = (effect.name, levels[0]), (effect.name, levels[-1])
    errors = ", ".join(
        f"{said} {percent(found.error(first, state).value)} to {percent(found.error(last, state).value)}"
        f"{_sure(found.change(last, first, state))}"
        for state, said in SAID.items()
    )
    areas = ", ".join(
        f"{said} {found.auc(first, state, DIM).value:.3f} to {found.auc(last, state, DIM).value:.3f}"
        f"{_sure(found.change(last, first, state, DIM))}"
        for state, said in SAID.items()
    )
    limit = found.auc(last, "limit", DIM).value
    shows = (
        f"From {effect.said(levels[0])} to {effect.said(levels[-1])}, error: {errors}. AUC of objects of "
        f"{100 * simulated.REFLECTANCES[DIM]:g} %: {areas}; without glint it ends at {limit:.3f}."
    )
    return shows, _hurts(found, effect)


def _sure(change: Number) -> str:
    """Whether a change is beyond its interval."""
    return "" if change.low > 0 or change.high < 0 else " (a change within the interval)"


def _hurts(found: Found, effect: Effect) -> str:
    """Where removal is worse than raw, or the default than Joyce alone."""
    parts = []
    for state, other in (("joyce", "raw"), ("default", "raw"), ("default", "joyce")):
        worse = _worse(found, effect, state, other)
        if worse:
            parts.append(f"{SAID[state]} against {SAID[other]}: {', '.join(worse)}")
    if not parts:
        return "Nowhere is removal worse than raw, or the default worse than Joyce alone, beyond the interval."
    return f"It hurts, beyond the 95 % interval of the difference: {'; '.join(parts)}."


def _worse(found: Found, effect: Effect, state: str, other: str) -> list[str]:
    """Levels at which a state has more error than another, or finds objects of some kind less well."""
    out = []
    for level in effect.chosen(found.quick):
        key = effect.name, level
        images = found.images[key]
        pairs = list(zip(images[state], images[other], strict=True))
        said = []
        if over_seeds([a.error - b.error for a, b in pairs]).low > 0:
            said.append(
                f"error {percent(found.error(key, other).value)} becomes {percent(found.error(key, state).value)}"
            )
        for kind, reflectance in enumerate(simulated.REFLECTANCES):
            less = over_seeds([float(b.auc[kind] - a.auc[kind]) for a, b in pairs])
            if less.low > 0 and less.value >= LEAST:
                before, after = (found.auc(key, s, kind).value for s in (other, state))
                said.append(f"AUC of {100 * reflectance:g} % {before:.3f} becomes {after:.3f}")
        if said:
            out.append(f"{effect.said(level)} ({', '.join(said)})")
    return out
