"""Speed of the correction of tiles and of the command `deglint remove`.

Tiles with their halos come from an array in memory or from a file in the page cache. They are corrected with and
without compensation, and are not written; the time is compared with that of reading the array. Commands are whole
processes and are compared with a copy of the file's blocks. All are measured in turns.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import rasterio

import deglint
from deglint import tiles as tiling
from deglint.physics.presets import preset
from deglint.pipeline.correct import Correction, correction
from deglint.pipeline.fit import fit_scene
from deglint.pipeline.overview import raster_of
from deglint.pipeline.recipe import Recipe
from deglint.raster.environment import environment
from deglint.raster.simulated import write_scene
from deglint.raster.source import ArraySource
from deglint.simulate import Setup, simulate

from .processes import in_turns
from .timing import in_turns as jobs_in_turns
from .timing import machine, say

BLOCK = 512
"""Side of the blocks of files [pixel]."""


def base(place: Path, side: int, wind: float = 9.0, delay: float = 0.06) -> Path:
    """Simulate a square sea for the thesis' sensor, with `delay` between bands [s]. Return its file of counts."""
    setup = Setup(sensor=preset("thesis").delayed(delay), size=(side, side), wind=wind, patch=0.06, sky="cardioidal",
                  seed=3)  # fmt: skip
    write_scene(simulate(setup), place / f"base_{wind:g}_{delay:g}")
    return place / f"base_{wind:g}_{delay:g}.tif"


def laid_out(small: Path, target: Path, side: int, dtype: str) -> Path:
    """Write a square scene repeated to `side` x `side` pixels: counts if `dtype` is "uint16", else physical values."""
    with rasterio.open(small) as given:
        counts, scales, part = given.read(), np.array(given.scales), given.height
        options = {"driver": "GTiff", "count": len(counts), "height": side, "width": side, "dtype": dtype,
                   "crs": given.crs, "transform": given.transform, "tiled": True, "blockxsize": BLOCK,
                   "blockysize": BLOCK, "interleave": "pixel"}  # fmt: skip
        with rasterio.open(target, "w", **options) as out:
            row = np.tile(counts, (1, 1, -(-side // part)))[:, :, :side]
            row = row if dtype == "uint16" else (row * scales[:, None, None]).astype(dtype)
            for first in range(0, side, part):
                last = min(first + part, side)
                out.write(row[:, : last - first], window=((first, last), (0, side)))
            out.update_tags(**{k: v for k, v in given.tags().items() if k != "AREA_OR_POINT"})
            out.descriptions = given.descriptions
            if dtype == "uint16":
                out.scales = given.scales
            for band in given.indexes:
                out.update_tags(band, **given.tags(band))
    return target


def work_of(path: Path, recipe: Recipe, *, memory: bool = False) -> tuple[Correction, list[tiling.Tile]]:
    """Fit a correction to a scene. Return it with the scene's tiles; with `memory`, its pixels come from memory."""
    scene = deglint.open_scene(path)
    work = correction(scene, fit_scene(scene, recipe, threads=2))
    if memory:
        with rasterio.open(path) as given:
            held = replace(scene, source=ArraySource(given.read(), raster_of(scene).info))
            work = replace(work, scene=held)
    return work, tiling.tiles(scene.height, scene.width, work.layout.tile)


def passed(work: Correction, tiles: list[tiling.Tile], threads: int) -> None:
    """Correct every tile and drop the results."""
    for _ in tiling.run(tiles, work, threads=threads):
        pass


def of_tiles(path: Path, others: dict[str, Path], rounds: int) -> list[list[str]]:
    """Rows of the table: name, threads, million values per second, processor time per value, wall time over reading.

    `others` are more scenes of the same size, by name; they are corrected only by default and in memory.
    """
    with rasterio.open(path) as given:
        values = given.read().astype(np.float32)
    jobs: dict[tuple[str, int], Callable[[], Any]] = {
        ("reading the float32 array (sum of each band)", 1): lambda: [float(b.sum()) for b in values]
    }
    recipes = {"default": Recipe(mask="none"), "removal alone": Recipe(compensate="off", mask="none")}
    scenes = [(name, path, recipe, memory) for name, recipe in recipes.items() for memory in (True, False)]
    scenes += [(f"default, {name}", other, recipes["default"], True) for name, other in others.items()]
    for name, scene, recipe, memory in scenes:
        work, tiles = work_of(scene, recipe, memory=memory)
        name = f"{name} ({work.chain.text})" if work.chain.runs else name
        for threads in (1, 2):
            key = f"{name}, of {'the array' if memory else 'a file'}", threads
            jobs[key] = lambda w=work, t=tiles, n=threads: passed(w, t, n)
    found = jobs_in_turns(jobs, rounds, lambda: np.array([time.perf_counter(), time.process_time()]))
    once, rows = None, []
    for (name, threads), runs in found.items():
        wall, best = np.median(runs, axis=0)[0], np.min(runs, axis=0)
        once = once or wall
        rate = f"{values.size / 1e6 / best[0]:.0f} / {values.size / 1e6 / wall:.0f}"
        rows.append([name, str(threads), rate, f"{1e9 * best[1] / values.size:.2f}", f"{wall / once:.1f}"])
    return rows


def commands(scene: Path, place: Path, rounds: int) -> list[list[str]]:
    """Rows of the table of commands: a copy of the file's blocks, and `deglint remove`."""
    out, python = str(place / "out.tif"), sys.executable
    found = in_turns({
        "block copy": [python, "-m", "benchmarks.floor", str(scene), out],
        "deglint remove": [python, "-m", "deglint", "remove", "-q", str(scene), out],
        "deglint remove --compensate off": [python, "-m", "deglint", "remove", "-q", "--compensate", "off",
                                            str(scene), out],
    }, rounds, [out + "*"])  # fmt: skip
    copies, rows = found["block copy"], []
    for name, runs in found.items():
        if isinstance(runs, str) or isinstance(copies, str):
            rows.append([name, str(runs), "", "", ""])
            continue
        beyond = median(run.wall - copy.wall for run, copy in zip(runs, copies, strict=True))
        rows.append([name, _spread([r.wall for r in runs]), f"{beyond:.2f}", _spread([r.cpu for r in runs]),
                     f"{max(run.peak for run in runs):.0f}"])  # fmt: skip
    return rows


def _spread(values: list[float]) -> str:
    return f"{median(values):.2f} ({min(values):.2f}-{max(values):.2f})"


def main(quick: bool, rounds: int | None, directory: Path | None) -> None:
    """Print the tables of tiles and of commands. `directory` is for scratch files."""
    rounds = rounds or (2 if quick else 5)
    print("## Rates\n\n" + machine())
    with tempfile.TemporaryDirectory(dir=directory) as name, environment(), tiling.one_thread_each():
        place = Path(name)
        part = 512 if quick else 1024
        small, side = base(place, part), 2 * part
        bases = {"simultaneous bands": base(place, part, delay=0.0)}
        for dtype in ("float32", "uint16"):
            others = {name: laid_out(scene, place / f"{scene.stem}_{dtype}.tif", side, dtype)
                      for name, scene in bases.items()}  # fmt: skip
            rows = of_tiles(laid_out(small, place / f"{dtype}.tif", side, dtype), others, rounds)
            head = ("", "threads", "million values a second, best / median", "processor time [ns a value]",
                    "times the reading")  # fmt: skip
            say(f"Tiles of 8 x {side}^2 {dtype}, corrected, not written", head, rows)
        side = 2048 if quick else 4096
        for dtype in ("uint16", "float32"):
            rows = commands(laid_out(small, place / f"large_{dtype}.tif", side, dtype), place, rounds)
            head = ("", "wall time [s]", "beyond the copy [s]", "processor time [s]", "peak memory [MB]")
            say(f"Commands on 8 x {side}^2 {dtype}", head, rows)
