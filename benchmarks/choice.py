"""How good the choice of a recipe is: expected against true error, and what the best candidate would have given."""

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
"""That docs compare on the sample scenes."""


def true_error(scene: Known, candidate: Candidate) -> float:
    """Of a candidate on the whole scene; infinite where it cannot be fitted [%]."""
    if candidate.method == "copy":
        return scene.error(open_scene(scene.path).read())
    try:
        return scene.error(deglinted(scene.path, Recipe(method=candidate.method, compensate=candidate.chain))[0])
    except DeglintError:
        return float("inf")


def short(candidate: Candidate) -> str:
    """Its name without what all openings have."""
    return candidate.name.replace(" pixels, wiener", "")


def main(quick: bool) -> None:
    """Measure and print."""
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
