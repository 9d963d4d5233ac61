"""Ships on glinted sea, with and without deglinting: `python -m benchmarks ships [--directory DIRECTORY]`.

First what contrast they keep, then how well they are found. DIRECTORY (by default beside the project) holds
casablanca.tif and honolulu.tif (Sentinel-2, with B08 as NIR), and beside each its *_ships.tif: 0 or a ship's number,
drawn by hand and loosely. Land is what is not water over more than a ship's area. A ship is found where
any of its pixels exceeds the threshold that one water pixel in a thousand, or in ten thousand, exceeds.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_dilation

from deglint import Recipe, apply, fit_scene, open_scene, remove_glint
from deglint.masks import water
from deglint.pipeline.look import look_at, role_bands
from detect import local_rx, residual_rx, subspace_rx
from detect.objects import label
from detect.rx import rx

from .error import DATA
from .harbours import ships as contrasts
from .timing import say

SHORES = (0, 10)  # pixels from land that are left out, with their surf, piers and mixed pixels
LARGEST = 600  # pixels of what is not water that may still be a ship
RATES = (1e-3, 1e-4)
WINDOW = {"inner": 15, "outer": 31}
NIR = 3


def at_sea(scene, shore: int) -> np.ndarray:
    """Water, and what is small enough to lie on it, off the shore."""
    look = look_at(scene, NIR, 1, wanted=True)
    other = label(~water(scene.read(bands=role_bands(look.roles)), look.water))
    land = (np.bincount(other.ravel()) > LARGEST)[other] & (other > 0)
    return ~(binary_dilation(land, iterations=shore) if shore else land)


def images(scene) -> dict[str, tuple[np.ndarray, list[int]]]:
    """The scene after each removal, and its NIR bands."""
    raw = scene.read()
    found = {"raw": (raw, [NIR]), "raw, without NIR and SWIR": (raw[:NIR], [])}
    for method in ("hedley", "lyzenga", "joyce", "nir-subtraction"):
        model = fit_scene(scene, Recipe(method=method, compensate="off"), threads=1).model
        clean = apply(raw, model)
        found[f"{method}"] = (clean, [NIR])
        found[f"{method}, without NIR and SWIR"] = (clean[:NIR], [])
    clean = as_the_command_does(scene)
    found["deglint remove"] = (clean, [NIR])
    found["deglint remove, without NIR and SWIR"] = (clean[:NIR], [])
    return found


def as_the_command_does(scene) -> np.ndarray:
    """What `deglint remove` makes of the scene by itself: NIR moved to each band's place, ships kept as they were."""
    with tempfile.TemporaryDirectory() as place:
        out = Path(place) / "clean.tif"
        remove_glint(scene.path, out, Recipe(nir=("B08",)), dtype="float32")
        return open_scene(out).read()


def detectors(image: np.ndarray, nir: list[int], sea: np.ndarray) -> dict[str, np.ndarray]:
    """Scores by each detector."""
    found = {
        "rx": rx(image, mask=sea),
        "rx, mcd": rx(image, mask=sea, covariance="mcd"),
        "subspace": subspace_rx(image, mask=sea),
        "local 15,31": local_rx(image, mask=sea, **WINDOW),
    }
    if nir:
        found["residual"] = residual_rx(image, nir=nir, mask=sea)
    return found


def figures(scores: np.ndarray, ships: np.ndarray, sea: np.ndarray) -> list[str]:
    """Ships found at each rate, and false objects."""
    there = np.unique(ships[sea & (ships > 0)])
    empty = scores[sea & (ships == 0) & np.isfinite(scores)]
    cells = []
    for rate in RATES:
        over = np.nan_to_num(scores, nan=-np.inf) > np.quantile(empty, 1 - rate)
        hit = np.unique(ships[over & (ships > 0)])
        marked = label(over)
        touching = np.unique(marked[ships > 0])
        false = len(np.setdiff1d(np.unique(marked), touching)) - (0 not in touching)
        cells.append(f"{len(hit)}/{len(there)}, {false} false")
    return cells


def tables(scene, ships: np.ndarray, shore: int) -> None:
    """One table; removals that give the same figures share a row."""
    sea = at_sea(scene, shore)
    same: dict[tuple[str, ...], list[str]] = {}
    for removal, (image, nir) in images(scene).items():
        for method, scores in detectors(image, nir, sea).items():
            same.setdefault((method, *figures(scores, ships, sea)), []).append(removal)
    on = len(np.unique(ships[sea & (ships > 0)]))
    title = f"{scene.path}, {shore} pixels off the shore: {on} of {ships.max()} ships, {np.count_nonzero(sea)} pixels"
    head = ("detector", *(f"ships and false objects at Pfa {r:g}" for r in RATES), "removal")
    say(title, head, [[*key, "; ".join(names)] for key, names in sorted(same.items())])


def main(directory: Path | None) -> None:
    """Print the contrasts, and a table for each scene and distance from the shore."""
    directory = directory or DATA / "sentinel2"
    if not (directory / "casablanca_ships.tif").exists():
        raise SystemExit("ships: --directory names where casablanca.tif, honolulu.tif and their *_ships.tif lie.")
    contrasts(directory)
    for name in ("casablanca", "honolulu"):
        scene = open_scene(directory / f"{name}.tif", nir="B08")
        ships = open_scene(directory / f"{name}_ships.tif").read()[0].astype(int)
        for shore in SHORES:
            tables(scene, ships, shore)
