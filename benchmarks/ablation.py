"""How much does each piece of the compensation, and of the choice of a recipe, improve the default?

Prints for each piece the ratio of the error without the piece to the error of the default. A ratio of 1 means that the
piece has no effect, a ratio below 1 that it does harm. Without a piece of the compensation, the method and the rest of
the chain stay as the default chose them. Without a piece of the choice, another method and chain are used.
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
"""Method and chain of a recipe."""
PAYS = 1.03
"""A piece is worth its code only if its ratio reaches this on at least one scene."""
CANDIDATES = import_module("deglint.choose.candidates")  # the package has a function of this name, too


def without(stage: str, choice: Choice) -> Chosen:
    """The chosen method, and the chosen chain without a stage; "off" if only the removal is left."""
    best = choice.best
    left = ", ".join(s for s in best.chain.split(", ") if s.partition(":")[0] != stage)
    return best.method, "off" if left == "remove" else left


def opened(choice: Choice) -> Chosen:
    """Method and chain of the first candidate with a morphological opening; if there is none, those of the choice."""
    found = [t.candidate for t in choice.trials if "identify-level" in t.candidate.chain]
    best = found[0] if found else choice.best
    return best.method, best.chain


def same(choice: Choice) -> Chosen:
    """Method and chain as they were chosen."""
    return choice.best.method, choice.best.chain


def evenly(plain: Callable[..., Any], request: Any, *rest: Any, **more: Any) -> Any:
    """Call `plain`, the fit of the Wiener filter, so that it does not give faint glint more weight."""
    return plain(replace(request, faint_glint=False), *rest, **more)


def first(plain: Callable[..., list[int]], *sizes: Any) -> list[int]:
    """Call `plain`, which lists sides of windows, and return only the first, which is the largest."""
    return plain(*sizes)[:1]


def nothing(*_given: Any) -> tuple[()]:
    """Return an empty tuple; takes the place of a function that returns a tuple."""
    return ()


@dataclass(frozen=True)
class Piece:
    """A piece of the compensation or of the choice, and how to deglint a scene without it."""

    recipe: Callable[[Choice], Chosen] = same  # method and chain to use instead
    change: Callable[[], AbstractContextManager[Any]] = nullcontext  # disables the piece while this context is open
    part_of: str = ""  # the stage that uses the piece


PIECES = {
    "psf": Piece(partial(without, "psf")),
    "targets": Piece(partial(without, "targets")),
    "posterior": Piece(partial(without, "posterior")),
    "outlines": Piece(same, lambda: patch.object(background, "SMALLEST_OUTLINE", np.inf), "identify-level"),
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
    """Error without a piece over `error`, that of the default; 1 if the piece is not used, NaN if removal fails."""
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
    """Geometric mean, least and largest of ratios without NaN, as text."""
    return f"{np.exp(np.nanmean(np.log(ratios))):.2f} ({np.nanmin(ratios):.2f} to {np.nanmax(ratios):.2f})"


def main(quick: bool) -> None:
    """Print the ratios of all pieces, by groups of scenes."""
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
