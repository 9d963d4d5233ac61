"""What the ROC curves show, in words; every figure is computed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from . import simulated
from .measure import percent
from .section import over_seeds

if TYPE_CHECKING:
    from .roc import Found, Look


LEAST = 0.001
"""Change of an area that is worth a word."""
TITLES = {"before": "before system effects", "after": "after system effects",
          "thesis-chain": "after the thesis' chain and Joyce", "compensated": "after removal by default"}  # fmt: skip


def look(at: Look) -> str:
    """A look as a table names it."""
    zenith, azimuth = at
    side = {180.0: "to the glint", 0.0: "away", 90.0: "across"}.get(azimuth, f"azimuth {azimuth:g}")
    return f"{zenith:g} deg {side}" if zenith else "nadir"


def opening(seeds: int) -> tuple[str, ...]:
    """What was done, and how it is measured."""
    from .roc import RATES, WIND

    made = (
        f"The objects of the simulated scenes ({seeds} of each kind, {WIND:g} m/s, sun at 40 degrees, {simulated.SKY} "
        f"sky, {simulated.SIDE} x {simulated.SIDE} pixels) are looked for by squared Mahalanobis distance (RX) over "
        "COASTAL to RED from the mean and covariance of the deep water on the left; what lies more than "
        f"{simulated.SPREAD} pixels from every object is background. All eight bands find less where they look at "
        "different instants, so that five are the stronger rival of a removal."
    )
    states = (
        "Before system effects: sharp optics (f/2, no smear), all bands at one instant, no noise, no saturation. After "
        "them: f/10, half a pixel of smear, 60 ms from band to band, noise, 12 bits. Then the same after the chain of "
        "the thesis and Joyce, and after what deglint does by default, whose sample is the deep water here. No glint: "
        "the sensor's image of a sea that does not glint; no removal can be expected to do better."
    )
    read = (
        f"Pd is read at Pfa {' and '.join(f'{r:g}' for r in RATES)}, without interpolation. Intervals are those of the "
        "mean over seeds (Student's t), each point of a curve by itself. A look is the sensor's angle from the "
        "vertical as seen from the sea, and where it stands: opposite to the sun, across, or on the sun's side (away "
        "from the glint)."
    )
    return made, states, read


def finding(found: Found) -> str:
    """The chapter in a sentence."""
    kind = 0
    at = found.looks[0]
    before, after, cleaned = (found.auc(at, s, kind).value for s in ("before", "after", "compensated"))
    return (
        f"Seen from {look(at)}, objects of {100 * simulated.REFLECTANCES[kind]:g} % are told from water with an AUC of "
        f"{before:.3f} before system effects, {after:.3f} after them, and {cleaned:.3f} after removal by default."
    )


def of_errors(found: Found) -> str:
    """Where removal leaves a greater error than it found."""
    parts = []
    for state, name in (("compensated", "Removal by default"), ("thesis-chain", "the thesis' chain with Joyce")):
        worse = []
        for at in found.looks:
            pairs = zip(found.images[at, state], found.images[at, "after"], strict=True)
            if over_seeds([a.error - b.error for a, b in pairs]).low > 0:
                before, after = (found.error(at, s).value for s in ("after", state))
                worse.append(f"{look(at)} ({percent(before)} becomes {percent(after)})")
        where = ", ".join(worse) or "nowhere"
        parts.append(f"{name} makes the error larger, beyond the interval of the difference: {where}")
    return f"{'; '.join(parts)}."


def of_object(found: Found, kind: int) -> tuple[str, ...]:
    """What the curves of one kind of object show, and where removal hurts."""
    before, after, cleaned = ({at: found.auc(at, s, kind).value for at in found.looks}
                              for s in ("before", "after", "compensated"))  # fmt: skip
    lost = max(found.looks, key=lambda at: before[at] - after[at])
    won = max(found.looks, key=lambda at: cleaned[at] - after[at])
    left = min(found.looks, key=lambda at: cleaned[at])
    shows = (
        f"System effects cost most at {look(lost)}: an AUC of {before[lost]:.3f} becomes {after[lost]:.3f}. Removal by "
        f"default wins most at {look(won)}, from {after[won]:.3f} to {cleaned[won]:.3f}; after it the AUC is lowest at "
        f"{look(left)}, {cleaned[left]:.3f} (0.5 is chance)."
    )
    said = [_compared(found, kind, state, name) for state, name in
            (("compensated", "Removal by default"), ("thesis-chain", "The thesis' chain with Joyce"))]  # fmt: skip
    return f"{shows} {_at_rate(found, kind)}", " ".join(said)


def _at_rate(found: Found, kind: int) -> str:
    from .roc import RATES

    best = max(found.looks, key=lambda at: found.pd(at, "compensated", kind, 0).value
               - found.pd(at, "after", kind, 0).value)  # fmt: skip
    after, cleaned, limit = (found.pd(best, s, kind, 0).value for s in ("after", "compensated", "limit"))
    return (
        f"At a Pfa of {RATES[0]:g} it wins most at {look(best)}: Pd {after:.3f} becomes {cleaned:.3f}, and would be "
        f"{limit:.3f} without glint."
    )


def _compared(found: Found, kind: int, state: str, name: str) -> str:
    """Where a state is better or worse than no removal, beyond the interval of the paired difference."""
    gains = {at: found.gain(at, state, "after", kind) for at in found.looks}
    better = [look(at) for at, g in gains.items() if g.low > 0 and g.value >= LEAST]
    worse = [
        f"{look(at)} ({found.auc(at, 'after', kind).value:.3f} becomes {found.auc(at, state, kind).value:.3f})"
        for at, g in gains.items() if g.high < 0 and g.value <= -LEAST
    ]  # fmt: skip
    text = f"{name} raises the area beyond the 95 % interval of the difference: {', '.join(better) or 'nowhere'}"
    return f"{text}; it lowers it: {', '.join(worse) or 'nowhere'}."
