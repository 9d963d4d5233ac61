"""Does the removal of glint make depths that are estimated from the bands worse?

Measured depths are regressed on the logarithms of the bands (Lyzenga, Malinas, Tanis 2006,
doi:10.1109/TGRS.2006.872909) and on the ratio of logarithms of blue and green (Stumpf, Holderied, Sinclair 2003,
doi:10.4319/lo.2003.48.1_part_2.0547). Each depth is predicted by a fit to other parts of the scene, because depths are
measured along tracks, and neighbours have nearly the same depth.
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

Table = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.intp]

FOLDER = DATA / "real" / "sdb"
DEPTH_RECIPES = {
    "raw": None,
    "hedley": Recipe(method="hedley", compensate="off"),
    "wiener": Recipe(method="wiener", compensate="off"),
    "default": Recipe(),
}
BLOCKS = 10
"""Number of parts of the scene; each is left out in turn."""
SQUARE_SIDE = 16
"""Side of the squares that make up a part [pixel]: wider than the distance between tracks of soundings."""
DIVISIONS = 8
"""Number of random divisions of the scene into parts; errors are averaged over them."""
LEAST_OF_MEDIAN = 1e-4
"""Share of a band's median; smaller values are raised to it before the logarithm."""


def soundings(path: Path) -> Table:
    """Read the first three columns, X, Y and depth, of a dBASE table of numbers, (row, 3)."""
    data = path.read_bytes()
    count, head, size = struct.unpack("<IHH", data[4:12])
    widths = [data[i + 16] for i in range(32, head - 1, 32)]
    starts = np.cumsum([1, *widths])
    rows = [data[head + n * size : head + (n + 1) * size] for n in range(count)]
    return np.array([[float(row[a : a + w]) for a, w in zip(starts[:3], widths[:3], strict=False)] for row in rows])


def predictors(bands: Table) -> dict[str, Table]:
    """Predictors (row, column) of each regression, by its name; `bands` are blue, green and red, (3, row)."""
    logs = np.log(np.maximum(bands, LEAST_OF_MEDIAN * np.median(bands, axis=1, keepdims=True)))
    ratio = np.log(1000 * np.maximum(bands, 1e-6))
    one = np.ones(bands.shape[1])
    return {"log bands": np.stack([*logs, one], axis=1), "log ratio": np.stack([ratio[0] / ratio[1], one], axis=1)}


def inside(path: Path, soundings: Table) -> tuple[Table, Table, Numbers, Numbers]:
    """Read an image. Return its bands, and depth, row and column of the soundings that lie inside it."""
    scene = open_scene(path)
    column, row = (np.floor(v).astype(int) for v in ~scene.transform * (soundings[:, 0], soundings[:, 1]))
    on = (row >= 0) & (row < scene.height) & (column >= 0) & (column < scene.width)
    return scene.read().astype(np.float64), soundings[on, 2], row[on], column[on]


def squared_errors(columns: Table, depth: Table, square: Numbers) -> Table:
    """Squared error of each depth as predicted from other parts, mean over `DIVISIONS` [squared unit of depth]."""
    line, split = LinearRegression(fit_intercept=False), LeaveOneGroupOut()
    found = [cross_val_predict(line, columns, depth, groups=parts(square, s), cv=split) for s in range(DIVISIONS)]
    return np.asarray(np.mean(np.square(np.array(found) - depth), axis=0))


def squares(row: Numbers, column: Numbers) -> Numbers:
    """Number, from 0, of the square that each pixel lies in; squares have sides of `SQUARE_SIDE` pixels."""
    return np.asarray(np.unique(row // SQUARE_SIDE * 100_000 + column // SQUARE_SIDE, return_inverse=True)[1])


def parts(square: Numbers, seed: int = 0) -> Numbers:
    """Number of the part (of `BLOCKS`) of each pixel, given the pixel's square. A part consists of random squares."""
    return np.asarray((np.random.default_rng(seed).permutation(square.max() + 1) % BLOCKS)[square])


def difference(found: Table, raw: Table, square: Numbers) -> tuple[float, float]:
    """RMSE after removal minus RMSE of the raw image, from squared errors; and its standard error by a bootstrap."""
    sums = np.stack([np.bincount(square, v) for v in (found, raw, np.ones(len(raw)))])
    drawn = np.random.default_rng(0).integers(0, sums.shape[1], (1000, sums.shape[1]))
    one, other, count = sums[:, drawn].sum(axis=2)
    return float(found.mean() ** 0.5 - raw.mean() ** 0.5), float(np.std(np.sqrt(one / count) - np.sqrt(other / count)))


def main() -> None:
    """Print the error of depths that are predicted from the raw image, and after removal by each recipe."""
    if not FOLDER.exists():
        print(f"no soundings at {FOLDER}: nothing was measured")
        return
    image, rows, head, before = FOLDER / "image.tif", [], ["bands"], dict[str, Table]()
    raw, depth, row, column = inside(image, soundings(FOLDER / "depth_sample.dbf"))
    square = squares(row, column)
    for name, recipe in DEPTH_RECIPES.items():
        bands = (raw if recipe is None else removed(image, recipe))[:3, row, column]
        found = {k: squared_errors(x, depth, square) for k, x in predictors(bands).items()}
        before = before or found
        said = [(float(np.sqrt(v.mean())), *difference(v, before[k], square)) for k, v in found.items()]
        head = ["bands", *found, "zero or less"]
        rows.append([name, *(f"{e:.3f} ({d:+.3f} +- {s:.3f})" for e, d, s in said), f"{(bands <= 0).mean():.2%}"])
    say(
        f"Error of {len(depth)} depths, {depth.min():.1f} to {depth.max():.1f} m: RMSE [m]", head, rows,
        f"Of {DIVISIONS} random divisions of {square.max() + 1} squares of {SQUARE_SIDE} pixels into {BLOCKS} parts; "
        "difference from raw and its standard error.",
    )  # fmt: skip
