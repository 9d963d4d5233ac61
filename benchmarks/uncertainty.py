"""Are standard errors as large as the errors? On simulated scenes, whose truth is known.

Ratio: root mean square of the error over root mean square of the standard error, of clean pixels and of replaced ones;
spread: half of what lies between the 16th and the 84th percentile of error over standard error, 1 for a normal one.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from deglint import Recipe, fit_scene, open_scene
from deglint.compensate.uncertainty import Parts, stderr
from deglint.physics.presets import preset
from deglint.pipeline.correct import Correction
from deglint.pipeline.look import raster_of
from deglint.pipeline.uncertain import with_stderr
from deglint.raster.output import Layout
from deglint.raster.simulated import write_scene
from deglint.simulate import Setup, simulate, thesis_array
from deglint.tiles import Tile
from detect.bench.measure import VISIBLE

from .error import DATA
from .timing import machine, say

Array = npt.NDArray[np.floating]
SIDE, LEAST = 320, 200
SEEDS = (11, 12)
"""Not those that the constants were set on (1 to 3)."""


def deglinted(path: Path, compensate: str = "auto") -> tuple[Parts, Array, tuple[int, ...]]:
    """A scene's parts, the standard errors, and their bands."""
    scene = open_scene(path)
    with raster_of(scene):
        fitted = fit_scene(scene, Recipe(mask="none", compensate=compensate), threads=1)
        info = raster_of(scene).info
        layout = Layout(info, tuple(range(len(scene.bands))), "float32", None, {})
        work = Correction(scene, fitted.model, False, False, layout, None, None, (), None, fitted.chain)
        whole = Tile(0, scene.height, 0, scene.width)
        work = with_stderr(work, [whole], (), 1)
        parts = replace(work, uncertainty=None)(whole).parts
    assert parts is not None
    assert work.uncertainty is not None
    return parts, stderr(parts, work.uncertainty), tuple(work.changed)


def compare(parts: Parts, claimed: Array, bands: tuple[int, ...], truth: Array) -> dict[str, tuple[Array, Array]]:
    """Error and standard error of visible and other bands, clean and replaced, in units of the water's level."""
    out: dict[str, list[tuple[Array, Array]]] = {}
    for i, band in enumerate(bands):
        level = np.median(truth[band])
        error, se = (parts.after[band] - truth[band]) / level, claimed[i] / level
        replaced = np.zeros_like(parts.where) if parts.replaced is None else parts.replaced[band]
        kept = np.zeros_like(parts.where) if parts.kept is None else parts.kept
        for name, where in (("clean", ~replaced & ~kept), ("replaced", replaced & ~kept)):
            if where.sum() >= LEAST:
                kind = f"{'visible' if band < VISIBLE else 'longer'} {name}"
                out.setdefault(kind, []).append((error[where], se[where]))
    return {k: (np.concatenate([e for e, _ in v]), np.concatenate([s for _, s in v])) for k, v in out.items()}


KINDS = ("visible clean", "visible replaced", "longer clean", "longer replaced")


def row(name: str, path: Path, compensate: str = "auto") -> list[str]:
    """A row of the table."""
    truth = open_scene(path.with_name(f"{path.stem}_truth.tif")).read().astype(np.float64)
    found = compare(*deglinted(path, compensate), truth)
    cells = []
    for kind in KINDS:
        if kind not in found:
            cells.append("-")
            continue
        error, se = found[kind]
        ratio = np.sqrt((error**2).mean() / (se.astype(np.float64) ** 2).mean())
        low, high = np.percentile(error / se, [16, 84])
        cells.append(f"{100 * np.sqrt((error**2).mean()):.2f} %, {ratio:.2f}, {(high - low) / 2:.2f}")
    return [name, *cells]


def scenes(folder: Path, quick: bool) -> Iterator[tuple[str, Path]]:
    """Simulated scenes: winds, patches, delays and seeds; every second one with squares on the ground."""
    base = preset("thesis")
    for seed in SEEDS[: 1 if quick else None]:
        for wind in (5.0,) if quick else (2.0, 5.0, 9.0):
            for patch in (0.005,) if quick else (0.005, 0.06):
                for delay in (0.06, 0.0):
                    things = thesis_array((SIDE, SIDE), 0.25, sides=(16,)) if (seed + (delay > 0)) % 2 else ()
                    setup = Setup(
                        sensor=base.delayed(delay), size=(SIDE, SIDE), wind=wind, patch=patch, sky="cardioidal",
                        seed=seed, objects=things,
                    )  # fmt: skip
                    name = f"{wind:g} m/s, patch {patch:g}, {1e3 * delay:g} ms, seed {seed}" + ", squares" * bool(
                        things
                    )
                    path = folder / f"{wind:g}-{patch:g}-{delay:g}-{seed}.tif"
                    write_scene(simulate(setup), path)
                    yield name, path


def main(quick: bool) -> None:
    """Measure and print."""
    print("## Standard errors\n\n" + machine())
    head = ("", *KINDS)
    note = ("Root mean square of the error in percent of the water's level, its ratio to that of the standard error, "
            "spread of error over standard error.")  # fmt: skip
    crops = sorted(p for p in (DATA / "simulated").glob("wind*.tif") if p.stem.count("_") == 1 + ("f30" in p.stem)
                   + ("sun30" in p.stem) and not p.stem.endswith(("_truth", "_glint", "_objects")))  # fmt: skip
    if crops and not quick:
        say("Scenes of another simulator", head, [row(p.stem, p) for p in crops], note)
    with tempfile.TemporaryDirectory() as folder:
        rows, plain = [], []
        for name, path in scenes(Path(folder), quick):
            rows.append(row(name, path))
            if " 0 ms" in name:
                plain.append(row(name, path, "off"))
        say("Simulated here", head, rows, note)
        say("Removal alone, bands at one instant", head, plain, note)
