"""Are standard errors as large as true errors? The ratio of their root mean squares, in simulated scenes."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from deglint import open_scene, remove_glint

from .scenes import Array, Case, Known
from .timing import machine, say

CASES = {
    "squares, 60 ms": Case(9, seed=9201, kinds=("square",)),
    "squares, 20 ms": Case(5, 0.02, seed=9202, kinds=("square",)),
    "squares, simultaneous": Case(9, 0.0, seed=9203, kinds=("square",)),
    "discs, 60 ms": Case(9, seed=9204, kinds=("disc",)),
    "discs, simultaneous": Case(5, 0.0, seed=9205, kinds=("disc",)),
    "f/30, 60 ms": Case(9, seed=9206, sensor="thesis-f30"),
    "f/30, simultaneous": Case(7, 0.0, seed=9207, sensor="thesis-f30"),
    "0.5 m, WorldView-3's delays": Case(9, None, 0.5, 9208, "worldview3"),
    "1 m, WorldView-3's delays": Case(9, None, 1.0, 9209, "worldview3"),
    "1 m, simultaneous": Case(7, 0.0, 1.0, 9210, "worldview3"),
    "10 m, Sentinel-2": Case(7, None, 10.0, 9211, "sentinel2"),
    "10 m, simultaneous": Case(9, 0.0, 10.0, 9212, "sentinel2"),
}
"""Scenes by name. No constant was set on their seeds."""
QUICK_CASES = ("squares, 60 ms", "1 m, simultaneous")
LEAST_PIXELS = 200
"""Fewest values of which a ratio is computed."""


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values, dtype=np.float64))))


def ratio(known: Known, image: Array, claimed: dict[int, Array], bands: list[int]) -> str:
    """Ratio of standard errors (`claimed`, by band) to true errors, and the size of these, as text."""
    errors, shares = [], []
    for b in bands:
        seen = np.isfinite(claimed[b]) & known.counts
        errors.append((image[b] - known.truth[b])[seen] / known.level[b])
        shares.append(claimed[b][seen] / known.level[b])
    error, share = np.concatenate(errors or [[]]), np.concatenate(shares or [[]])
    return f"{rms(share) / rms(error):.2f} ({100 * rms(error):.1f} %)" if error.size >= LEAST_PIXELS else "-"


def row(name: str, case: Case, place: Path) -> list[str]:
    """Row of the table: name, chosen recipe, and ratios in visible and longer bands. `place` is for files."""
    known = Known.of(case.written(place))
    result = remove_glint(known.path, place / "out.tif", stderr=place / "se.tif", dtype="float32", overwrite=True)
    scene, errors = open_scene(place / "out.tif"), open_scene(place / "se.tif")
    names = [f"standard error of {b.name}" for b in scene.bands]
    claimed = {names.index(b.name): plane for b, plane in zip(errors.bands, errors.read(), strict=True)}
    image = scene.read().astype(np.float64)
    visible, longer = ([b for b in claimed if (b in known.visible) == seen] for seen in (True, False))
    chosen = result.fitted.choice.best.name if result.fitted.choice else ""
    return [name, chosen, *(ratio(known, image, claimed, bands) for bands in (visible, longer))]


def main(quick: bool) -> None:
    """Print the ratios of all cases."""
    print("## Standard errors\n\n" + machine())
    with tempfile.TemporaryDirectory() as folder:
        rows = [row(name, case, Path(folder)) for name, case in CASES.items() if not quick or name in QUICK_CASES]
    head = ("", "recipe", "visible", "longer")
    note = ("Root mean square of the standard error over that of the error (root mean square error, relative to the "
            "water): above 1 too much is claimed.")  # fmt: skip
    say("Claimed over real", head, rows, note)
