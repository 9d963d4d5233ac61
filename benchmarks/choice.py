"""How good is the choice of a recipe? Its expected and its true error, and the true error of the best candidate."""

from __future__ import annotations

import numpy as np

from deglint import Recipe, open_scene
from deglint.choose import Candidate
from deglint.errors import DeglintError

from .scenes import Known, deglinted, scenes
from .timing import ROOT, machine, say

CHAINS = (
    Candidate("hedley", "hedley"),
    Candidate("wiener", "wiener"),
    Candidate("wiener, posterior mean", "wiener", "targets, remove, posterior"),
    Candidate("opening of 13 pixels, wiener", "wiener", "psf:2, identify-level:13, targets, replace-level, remove"),
)
"""Candidates whose errors on the sample scenes docs/ compares."""


def true_error(scene: Known, candidate: Candidate) -> float:
    """Error of a candidate on the whole scene [%]; infinite if the candidate cannot be fitted."""
    if candidate.method == "copy":
        return scene.error(open_scene(scene.path).read())
    try:
        return scene.error(deglinted(scene.path, Recipe(method=candidate.method, compensate=candidate.chain))[0])
    except DeglintError:
        return float("inf")


def short(candidate: Candidate) -> str:
    """Name of a candidate; that of an opening is written without ", wiener"."""
    return candidate.name.replace("pixels, wiener", "pixels")


def main(quick: bool) -> None:
    """Print chosen and best candidates of all scenes, and the errors of `CHAINS` on the sample scenes."""
    print("## Choice\n\n" + machine())
    rows, expected, regrets = [], [], []
    for _group, scene in scenes(quick):
        image, fitted = deglinted(scene.path)
        assert fitted.choice is not None
        choice, own = fitted.choice, scene.error(image)
        errors = {t.candidate: own if t.candidate == choice.best else true_error(scene, t.candidate)
                  for t in choice.trials}  # fmt: skip
        if choice.trial is None:
            continue
        best = min(errors, key=errors.__getitem__)
        regrets.append(own / errors[best])
        expected.append(100 * choice.trial.error / own)
        rows.append([scene.path.stem, short(choice.best), f"{100 * choice.trial.error:.1f}", f"{own:.1f}",
                     short(best), f"{errors[best]:.1f}", f"{regrets[-1]:.2f}"])  # fmt: skip
    head = ("", "chosen", "expected [%]", "true [%]", "best candidate", "true [%]", "regret")
    regret, off = np.exp(np.mean(np.log(regrets))), np.exp(np.median(np.abs(np.log(expected))))
    note = (f"Regret: error of the chosen candidate over that of the best: {regret:.2f} in the geometric mean, at most "
            f"{max(regrets):.2f}; 1.05 or less on {sum(r <= 1.05 for r in regrets)} of {len(regrets)} scenes. Expected "
            f"errors are off by a factor of {off:.2f} in the median.")  # fmt: skip
    say("Chosen and best", head, rows, note)
    rows = []
    for name in ("sea_025m", "sea_1m", "sea"):
        scene = Known.of(ROOT / "sample_data" / f"{name}.tif")
        errors = [scene.error(open_scene(scene.path).read()), *(true_error(scene, c) for c in CHAINS)]
        rows.append([name, *(f"{e:.0f}" for e in errors)])
    say("Error on the sample scenes [%]", ("", "raw", *(c.name for c in CHAINS)), rows)
