"""What each piece of compensation and of the choice pays: the error without it over that of the default.

A stage is dropped from the chain that the default chose, other pieces are replaced by what does without them, and the
choice stays as it was; without a piece of the choice the scene is fitted anew. A figure of 1 says that the piece does
nothing there, one below 1 that it does harm.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from typing import Any
from unittest.mock import patch

import numpy as np

from deglint import Recipe
from deglint.choose import Choice
from deglint.compensate import background
from deglint.errors import DeglintError
from deglint.pipeline import sample
from deglint.remove import wiener

from .scenes import Known, deglinted, scenes
from .timing import machine, say

Chosen = tuple[str, str]
"""Method and chain."""
PAYS = 1.03
"""A piece that pays less than this on every scene is not worth its code."""
CANDIDATES = import_module("deglint.choose.candidates")  # the package has a function of this name, too


def without(stage: str, choice: Choice) -> Chosen:
    """The chosen chain without a stage; alone the removal is no chain."""
    best = choice.best
    left = ", ".join(s for s in best.chain.split(", ") if s.partition(":")[0] != stage)
    return best.method, "off" if left == "remove" else left


def opened(choice: Choice) -> Chosen:
    """Method and chain of the simplest candidate with an opening; of the chosen one if no such candidate was tried."""
    found = [t.candidate for t in choice.trials if "identify-level" in t.candidate.chain]
    best = found[0] if found else choice.best
    return best.method, best.chain


def same(choice: Choice) -> Chosen:
    """As it was chosen."""
    return choice.best.method, choice.best.chain


def evenly(plain: Callable[..., Any], request: Any, *rest: Any, **more: Any) -> Any:
    """A fit of the Wiener filter in which strong and faint glint weigh the same."""
    return plain(replace(request, faint_glint=False), *rest, **more)


def first(plain: Callable[..., list[int]], *sizes: Any) -> list[int]:
    """The largest window alone."""
    return plain(*sizes)[:1]


def nothing(*_given: Any) -> tuple[()]:
    """In the place of what gives a tuple."""
    return ()


@dataclass(frozen=True)
class Piece:
    """A piece: the recipe without it, by the choice; what is replaced; and in which chains it is at all."""

    recipe: Callable[[Choice], Chosen] = same
    change: Callable[[], AbstractContextManager[Any]] = nullcontext
    part_of: str = ""


PIECES = {
    "psf": Piece(partial(without, "psf")),
    "targets": Piece(partial(without, "targets")),
    "posterior": Piece(partial(without, "posterior")),
    "outlines": Piece(same, lambda: patch.object(background, "_limit", lambda *_: None), "identify-level"),
    "ringing": Piece(same, lambda: patch.object(background, "ringing", nothing), "identify-level"),
    "red edge as reference": Piece(same, lambda: patch.object(sample, "more_references", nothing), "posterior"),
    "faint weighting": Piece(same, lambda: patch.object(wiener, "fit", partial(evenly, wiener.fit)), "posterior"),
    "second window": Piece(
        lambda _: ("auto", "auto"), lambda: patch.object(CANDIDATES, "windows", partial(first, CANDIDATES.windows))
    ),
    "choice: always opening": Piece(opened),
    "choice: always wiener": Piece(lambda _: ("wiener", "off")),
}


def ratio(piece: Piece, scene: Known, choice: Choice, error: float) -> float:
    """Error without a piece over that with it; 1 where the piece has no part."""
    method, chain = piece.recipe(choice)
    windows = sum("identify-level" in t.candidate.chain for t in choice.trials)
    if piece.part_of not in choice.best.chain or (method == "auto" and windows < 2):
        return 1.0
    if (method, chain) == same(choice) and piece.change is nullcontext:
        return 1.0  # as where nothing was corrected
    with piece.change():
        try:
            return scene.error(deglinted(scene.path, Recipe(method=method, compensate=chain))[0]) / error
        except DeglintError:
            return float("nan")


def spread(ratios: list[float]) -> str:
    """Geometric mean, least and largest, as text."""
    return f"{np.exp(np.nanmean(np.log(ratios))):.2f} ({np.nanmin(ratios):.2f} to {np.nanmax(ratios):.2f})"


def main(quick: bool) -> None:
    """Measure and print."""
    print("## Ablation\n\n" + machine())
    found: dict[str, dict[str, list[float]]] = {name: defaultdict(list) for name in PIECES}
    names, errors = [], defaultdict(list)
    for group, scene in scenes(quick):
        image, fitted = deglinted(scene.path)
        assert fitted.choice is not None
        error = scene.error(image)
        names.append(scene.path.stem)
        errors[group].append(error)
        for name, piece in PIECES.items():
            found[name][group].append(ratio(piece, scene, fitted.choice, error))
        last = ", ".join(f"{name} {groups[group][-1]:.3f}" for name, groups in found.items())
        print(f"{group} {names[-1]}: {fitted.choice.best.name}, {error:.2f} %; {last}", file=sys.stderr, flush=True)
    rows = []
    for name, groups in found.items():
        every = [r for ratios in groups.values() for r in ratios]
        most = int(np.nanargmax(every))
        where = f"{every[most]:.2f}, {names[most]}" if every[most] >= PAYS else "pays less than 3 % on every scene"
        rows.append([name, *map(spread, groups.values()), where])
    head = ("without", *(f"{g}: {len(e)} scenes, error {np.exp(np.mean(np.log(e))):.1f} %" for g, e in errors.items()))
    note = ("Error without the piece over that of the default: geometric mean (least to largest). Errors are those of "
            "the visible bands, relative to the water.")  # fmt: skip
    say("Without a piece", (*head, "most"), rows, note)
