"""Sidecar of a score raster: versions, inputs, options, decisions and results."""

from dataclasses import asdict
from typing import Any

from deglint import __version__
from deglint.checksum import Checksum
from deglint.errors import DeglintError
from deglint.pipeline.outputs import versions
from deglint.readers.text import read_json

from ..local import STATES
from ..sea import SEA_WINDOW
from ..threshold import Threshold
from .plan import UNKNOWN_PIXEL, Plan
from .recipe import Outputs
from .scoring import MEANINGS, PixelCounts

AFFINE = ("hedley", "lyzenga", "joyce", "nir-subtraction")
"""Glint removals that subtract a multiple of the NIR from each band."""
_MOST_BANDS = 32
"""Maximum number of bands for which the sidecar contains the covariance."""
_FEW_PIXELS = 10
"""Pixels per band below which the error of the estimated covariance raises the scores noticeably."""


def describe(
    plan: Plan, targets: Outputs, threshold: Threshold | None, tally: PixelCounts, checksum: Checksum
) -> dict[str, Any]:
    """Versions, inputs, options and results of a run as plain values for JSON."""
    recipe = asdict(plan.recipe)
    recipe["bands"] = list(plan.names)
    recipe["nir"] = [plan.names[b] for b in plan.nir]
    if plan.recipe.method == "local":
        inner, outer = plan.recipe.window
        recipe["ring_pixels"] = outer * outer - inner * inner
    numbers = plan.background.numbers() if plan.background else None
    if numbers and len(plan.bands) > _MOST_BANDS:
        numbers["covariance"] = "left out: --save-background writes it"
    return {
        "detect": __version__,
        "versions": versions(),
        "input": checksum.result(),
        "product": plan.scene.product,
        "output": str(targets.image),
        "flags": {"file": str(targets.flags), "bits": MEANINGS} if targets.flags else None,
        "recipe": recipe,
        "background": numbers,
        "water": plan.water[0].numbers() if plan.water else None,
        "sea": plan.model.numbers() if plan.model else None,
        "threshold": asdict(threshold) if threshold else None,
        "pixels": asdict(tally),
    }


def notes_on(plan: Plan) -> list[str]:
    """Notes on the decisions of a run, one line each."""
    notes = [f"{plan.recipe.method} on {len(plan.bands)} bands: {', '.join(plan.names)}"]
    if plan.sea and plan.model:
        size = f"{plan.sea.pixel:.3g} m" if plan.pixel_area else f"of unknown size, taken as {UNKNOWN_PIXEL:g} m"
        what = "brighter or darker" if plan.model.side == "both" else "brighter"
        even = ", relative to water of the same NIR" if plan.model.glint else ""
        notes.append(f"sea: pixels {size}; ships of up to {plan.sea.length:g} m by {plan.sea.width:g} m")
        notes.append(f"sea: searched for what is {what} than the water within {SEA_WINDOW} pixels{even}")
    if background := plan.background:
        where = "read from a file" if plan.given else f"{background.n} pixels"
        shrunk = f", {background.rule} {background.shrinkage:.3g}" if background.shrinkage else ""
        notes.append(f"background: {where}, rank {background.rank} of {background.bands}{shrunk}")
    return notes


def warnings_of(plan: Plan, threshold: Threshold | None, tally: PixelCounts) -> list[str]:
    """Warnings about the reliability of the scores."""
    said = []
    if background := plan.background:
        if background.rank < background.bands:
            said.append(
                f"{background.bands - background.rank} of {background.bands} bands do not vary or follow from others: "
                "scored as if they were not there"
            )
        if background.n < _FEW_PIXELS * background.bands:
            said.append(
                f"the background has {background.n} pixels for {background.bands} bands: scores follow F, "
                "not chi-squared (--threshold f), or take --covariance ledoit-wolf"
            )
    for count, state in zip((tally.deficient, tally.too_few), STATES, strict=True):
        if count:
            said.append(f"{count} of {tally.total} pixels: {STATES[state]}")
    if threshold is not None:
        said += threshold.notes
    if line := _removal_without_effect(plan):
        said.append(line)
    return said


def _removal_without_effect(plan: Plan) -> str | None:
    """Warning that the glint removal of the input does not change the scores; None where it does.

    Invariant detectors give the scores of the glinted scene if the removal was linear and its NIR is in use.
    """
    if not plan.recipe.kind.invariant or plan.recipe.covariance not in ("empirical", "mcd"):
        return None
    try:
        made = read_json(f"{plan.scene.path}.json", "sidecar")
        model = made["model"]
        kept = {model["band_names"][b] for index in model["indexes"] for b in index["bands"]} <= set(plan.names)
        affine = model["method"] in AFFINE and bool(model["fits"]) and not made["pixels"]["protected"]
    except (DeglintError, KeyError, TypeError, IndexError):
        return None
    if not (affine and kept):
        return None
    return (
        f"{plan.recipe.method} scores do not change under {model['method']} as long as the NIR is among the bands: "
        "these are the scores of the glinted scene. For the removal to count, leave the NIR out with -b"
    )
