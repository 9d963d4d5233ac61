"""Depths from the bands after removal: does removal cost an analyst anything that the water told?

Soundings are regressed on the logarithms of the bands (Lyzenga, Malinas, Tanis 2006, doi:10.1109/TGRS.2006.872909) and
on the ratio of logarithms of blue and green (Stumpf, Holderied, Sinclair 2003, doi:10.4319/lo.2003.48.1_part_2.0547).
The error is that of predictions by fits to other parts of the scene: soundings lie in tracks, and a neighbour left in
would tell the depth of the one left out.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import numpy.typing as npt
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import LeaveOneGroupOut, cross_val_predict

from deglint import Recipe, open_scene

from .files import DATA, removed
from .timing import say

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.intp]

FOLDER = DATA / "real" / "sdb"
RECIPES = {
    "raw": None,
    "hedley": Recipe(method="hedley", compensate="off"),
    "wiener": Recipe(method="wiener", compensate="off"),
    "default": Recipe(),
}
BLOCKS = 10
"""Parts of the scene that are left out in turn."""
SIDE = 16
"""Side of the squares that the parts are made of [pixel]: wider than the tracks of soundings are apart."""
DIVISIONS = 8
"""Divisions into parts that are averaged over."""
LEAST = 1e-4
"""Values below this share of a band's median have no logarithm worth the name."""


def soundings(path: Path) -> Array:
    """X, Y and depth of a table of numbers in dBASE format, (row, 3)."""
    data = path.read_bytes()
    count, head, size = struct.unpack("<IHH", data[4:12])
    widths = [data[i + 16] for i in range(32, head - 1, 32)]
    starts = np.cumsum([1, *widths])
    rows = [data[head + n * size : head + (n + 1) * size] for n in range(count)]
    return np.array([[float(row[a : a + w]) for a, w in zip(starts[:3], widths[:3], strict=False)] for row in rows])


def predictors(bands: Array) -> dict[str, Array]:
    """Columns of each regression, from blue, green and red (3, row)."""
    logs = np.log(np.maximum(bands, LEAST * np.median(bands, axis=1, keepdims=True)))
    ratio = np.log(1000 * np.maximum(bands, 1e-6))
    one = np.ones(bands.shape[1])
    return {"log bands": np.stack([*logs, one], axis=1), "log ratio": np.stack([ratio[0] / ratio[1], one], axis=1)}


def inside(path: Path, soundings: Array) -> tuple[Array, Array, Numbers, Numbers]:
    """Raw bands of an image, and depth, row and column of the soundings that lie on it."""
    scene = open_scene(path)
    column, row = (np.floor(v).astype(int) for v in ~scene.transform * (soundings[:, 0], soundings[:, 1]))
    on = (row >= 0) & (row < scene.height) & (column >= 0) & (column < scene.width)
    return scene.read().astype(np.float64), soundings[on, 2], row[on], column[on]


def squared_errors(columns: Array, depth: Array, square: Numbers) -> Array:
    """Squared error of each depth predicted from the other parts, mean of `DIVISIONS` [unit of depth squared]."""
    line, split = LinearRegression(fit_intercept=False), LeaveOneGroupOut()
    found = [cross_val_predict(line, columns, depth, groups=parts(square, s), cv=split) for s in range(DIVISIONS)]
    return np.asarray(np.mean(np.square(np.array(found) - depth), axis=0))


def squares(row: Numbers, column: Numbers) -> Numbers:
    """Number of the square of `SIDE` pixels that each pixel lies in, from 0."""
    return np.asarray(np.unique(row // SIDE * 100_000 + column // SIDE, return_inverse=True)[1])


def parts(square: Numbers, seed: int = 0) -> Numbers:
    """Which of `BLOCKS` parts each pixel belongs to: squares of the scene, dealt out at random."""
    return np.asarray((np.random.default_rng(seed).permutation(square.max() + 1) % BLOCKS)[square])


def difference(found: Array, raw: Array, square: Numbers) -> tuple[float, float]:
    """Root mean square of errors minus that of others, both given squared; standard error by a bootstrap of squares."""
    sums = np.stack([np.bincount(square, v) for v in (found, raw, np.ones(len(raw)))])
    drawn = np.random.default_rng(0).integers(0, sums.shape[1], (1000, sums.shape[1]))
    one, other, count = sums[:, drawn].sum(axis=2)
    return float(found.mean() ** 0.5 - raw.mean() ** 0.5), float(np.std(np.sqrt(one / count) - np.sqrt(other / count)))


def main() -> None:
    """Print the error of depths from the raw image and after each recipe."""
    if not FOLDER.exists():
        print(f"no soundings at {FOLDER}: nothing was measured")
        return
    image, rows, head, before = FOLDER / "image.tif", [], ["bands"], dict[str, Array]()
    raw, depth, row, column = inside(image, soundings(FOLDER / "depth_sample.dbf"))
    square = squares(row, column)
    for name, recipe in RECIPES.items():
        bands = (raw if recipe is None else removed(image, recipe))[:3, row, column]
        found = {k: squared_errors(x, depth, square) for k, x in predictors(bands).items()}
        before = before or found
        said = [(float(np.sqrt(v.mean())), *difference(v, before[k], square)) for k, v in found.items()]
        head = ["bands", *found, "zero or less"]
        rows.append([name, *(f"{e:.3f} ({d:+.3f} +- {s:.3f})" for e, d, s in said), f"{(bands <= 0).mean():.2%}"])
    say(
        f"Error of {len(depth)} depths, {depth.min():.1f} to {depth.max():.1f} m: RMSE [m]", head, rows,
        f"Of {DIVISIONS} random divisions of {square.max() + 1} squares of {SIDE} pixels into {BLOCKS} parts; "
        "difference from raw and its standard error.",
    )  # fmt: skip
