"""Errors of every method with every chain, on every sea at every delay: what `thesis` measures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from deglint.physics.presets import preset

from . import chips, simulated
from .measure import bounded, rms_error
from .section import Effort, Number, over_seeds
from .simulated import Seen

METHODS = {"raw": "none", "hedley": "hedley", "lyzenga": "lyzenga", "joyce": "joyce", "multiband": "multiband",
           "auto": "auto"}  # fmt: skip
"""What `deglint remove --method` is told; "none" is no removal."""
CHAINS = {"alone": "off", "thesis-chain": "thesis", "compensated": "auto"}
"""What `deglint remove --compensate` is told."""
SHOWN = 9.0
"""Wind of the pictures, and of the examples in the words [m/s]."""

Key = tuple[float, float, str, str]
"""Wind [m/s], delay [s], method, chain."""


@dataclass(frozen=True)
class Errors:
    """Error of one image: of the whole scene, and of its deep water [%]."""

    whole: float
    deep: float


@dataclass(frozen=True)
class Found:
    """All that was measured.

    Attributes
    ----------
    winds, delays : tuple of float
        [m/s], [s]
    errors : dict
        By `Key`, one a seed; the method "noise" is the truth with noise, and "auto" has the chain "unprotected", too:
        --compensate auto that keeps no small things.
    pictures : dict
        Pieces of one scene by "truth" and "METHOD/CHAIN".
    failed : tuple of Key
        What could not be fitted, in some scene; it is not in `errors`.
    """

    winds: tuple[float, ...]
    delays: tuple[float, ...]
    errors: dict[Key, list[Errors]]
    pictures: dict[str, chips.Rgb]
    failed: tuple[Key, ...] = ()

    @property
    def shown(self) -> float:
        """The wind nearest to that of the pictures."""
        return min(self.winds, key=lambda w: abs(w - SHOWN))

    def mean(self, wind: float, delay: float, method: str, chain: str, what: str = "whole") -> Number | None:
        """Error with its interval, None where something could not be fitted."""
        errors = self.errors.get((wind, delay, method, chain))
        return bounded(over_seeds([getattr(e, what) for e in errors], "%"), 0) if errors else None

    def more(self, one: Key, other: Key) -> Number | None:
        """By how much one error exceeds another on the same scenes, with its interval [%]."""
        if one not in self.errors or other not in self.errors:
            return None
        pairs = zip(self.errors[one], self.errors[other], strict=True)
        return over_seeds([a.whole - b.whole for a, b in pairs], "%")


def measure(effort: Effort, winds: tuple[float, ...], delays: tuple[float, ...], side: int = simulated.SIDE) -> Found:
    """Measure all errors.

    Parameters
    ----------
    effort : Effort
    winds, delays : tuple of float
        [m/s], [s]
    side : int
        Of the scenes [pixel].
    """
    tasks = [(w, s) for w in sorted(winds, reverse=True) for s in range(effort.seeds)]  # the longest first
    shown = min(winds, key=lambda w: abs(w - SHOWN))
    results = simulated.each(
        lambda t: _one_sea(effort, t[0], t[1], delays, side, t == (shown, 0)), tasks, effort.threads
    )
    errors: dict[Key, list[Errors]] = {}
    failed: dict[Key, None] = {}
    pictures: dict[str, chips.Rgb] = {}
    for found, pieces in results:
        pictures |= pieces
        for key, value in found.items():
            if value is None:
                failed[key] = None
            else:
                errors.setdefault(key, []).append(value)
    whole = {key: values for key, values in errors.items() if key not in failed}
    return Found(tuple(sorted(winds)), tuple(sorted(delays)), whole, pictures, tuple(failed))


def _one_sea(
    effort: Effort, wind: float, seed: int, delays: tuple[float, ...], side: int, show: bool
) -> tuple[dict[Key, Errors | None], dict[str, chips.Rgb]]:
    made = simulated.setups([preset("thesis").delayed(d) for d in delays], wind, seed, side=side)
    errors: dict[Key, Errors | None] = {}
    pictures: dict[str, chips.Rgb] = {}
    for seen, delay in zip(simulated.see(made, effort.directory, f"thesis-{wind:g}-{seed}"), delays, strict=True):
        errors[wind, delay, "noise", "alone"] = _errors(seen, seen.noisy)
        last = show and delay == max(delays)
        if last:
            pictures["truth"] = _piece(seen, seen.truth)
        for method, told in METHODS.items():
            for chain, compensate in CHAINS.items():
                clean = simulated.cleaned_or_none(seen, told, compensate)
                errors[wind, delay, method, chain] = None if clean is None else _errors(seen, clean)
                if last and clean is not None:
                    pictures[f"{method}/{chain}"] = _piece(seen, clean)
        bare = simulated.cleaned_or_none(seen, "auto", "auto", protect=False)
        errors[wind, delay, "auto", "unprotected"] = None if bare is None else _errors(seen, bare)
        simulated.forget([seen])
    return errors, pictures


def _errors(seen: Seen, image: Any) -> Errors:
    return Errors(rms_error(image, seen.truth), rms_error(image, seen.truth, seen.deep))


def _piece(seen: Seen, image: Any) -> chips.Rgb:
    """The upper right quarter: objects of every reflectance, and water between."""
    rows, columns = seen.made.setup.size
    return chips.natural(image, seen.truth, slice(0, rows // 2), slice(columns // 2, columns))


def numbers(found: Found) -> dict[str, Number]:
    """Every number by name."""
    out = {}
    for (wind, delay, method, chain), errors in sorted(found.errors.items()):
        stem = f"thesis/wind{wind:02g}/delay{1000 * delay:02.0f}/{method}/{chain}"
        out[f"{stem}/rms"] = bounded(over_seeds([e.whole for e in errors], "%"), 0)
        out[f"{stem}/rms-deep"] = bounded(over_seeds([e.deep for e in errors], "%"), 0)
    return out
