"""What the numerical stress is made of: blocks of pixels that are hard in one way each, and data with certified values.

Every block is a small sea of four bands, the last of them the NIR, whose values are multiples of 1/64 so that an
offset of 1e8 or a type of eight bits adds no rounding of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Block = npt.NDArray[Any]
LEVELS = np.array([60.0, 50.0, 30.0, 20.0])
SLOPES = np.array([0.9, 0.8, 0.5, 1.0])
NIR = 3
ROWS, COLUMNS = 96, 104
DTYPES = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "float16", "float32", "float64")
# NIST Statistical Reference Datasets, https://www.itl.nist.gov/div898/strd: Norris, y then x
NORRIS = np.fromstring(
    """0.1 338.8 118.1 888.0 9.2 228.1 668.5 998.5 449.1 778.9 559.2 0.3 0.1 778.1 668.8 339.3 448.9 10.8 557.7 228.3
    998.0 888.8 119.6 0.3 0.6 557.6 339.3 888.0 998.5 778.9 10.2 117.6 228.9 668.4 449.2 0.2
    0.2 337.4 118.2 884.6 10.1 226.5 666.3 996.3 448.6 777.0 558.2 0.4 0.6 775.5 666.9 338.0 447.5 11.6 556.0 228.1
    995.8 887.6 120.2 0.3 0.3 556.8 339.1 887.2 999.0 779.0 11.1 118.3 229.2 669.1 448.9 0.5""",
    sep=" ",
).reshape(2, 36)  # fmt: skip
# Longley: y, x1 ... x6
LONGLEY = np.fromstring(
    """60323 83.0 234289 2356 1590 107608 1947 61122 88.5 259426 2325 1456 108632 1948 60171 88.2 258054 3682 1616
    109773 1949 61187 89.5 284599 3351 1650 110929 1950 63221 96.2 328975 2099 3099 112075 1951 63639 98.1 346999 1932
    3594 113270 1952 64989 99.0 365385 1870 3547 115094 1953 63761 100.0 363112 3578 3350 116219 1954 66019 101.2 397469
    2904 3048 117388 1955 67857 104.6 419180 2822 2857 118734 1956 68169 108.4 442769 2936 2798 120445 1957 66513 110.8
    444546 4681 2637 121950 1958 68655 112.6 482704 3813 2552 123366 1959 69564 114.2 502601 3931 2514 125368 1960 69331
    115.7 518173 4806 2572 127852 1961 70551 116.9 554894 4007 2827 130081 1962""",
    sep=" ",
).reshape(-1, 7).T  # fmt: skip
LONGLEY_SLOPES = np.array([
    15.0618722713733, -0.0358191792925910, -2.02022980381683, -1.03322686717359, -0.0511041056535807, 1829.15146461355,
])  # fmt: skip
NORRIS_SLOPE, NORRIS_ERROR, NORRIS_R2 = 1.00211681802045, 0.429796848199937e-3, 0.999993745883712
UNIVARIATE = {
    "NumAcc1": (np.array([10000001.0, 10000003.0, 10000002.0]), 10000002.0, 1.0),
    "NumAcc2": (np.array([1.2] + [1.1, 1.3] * 500), 1.2, 0.1),
    "NumAcc3": (np.array([1000000.2] + [1000000.1, 1000000.3] * 500), 1000000.2, 0.1),
    "NumAcc4": (np.array([10000000.2] + [10000000.1, 10000000.3] * 500), 10000000.2, 0.1),
}
"""Data, certified mean, certified standard deviation."""


@dataclass(frozen=True, eq=False)
class Case:
    """A block of pixels, and what is hard about it.

    Attributes
    ----------
    name : str
        For people.
    key : str
        In the names of numbers.
    block : (band, row, column) ndarray
    cell : int
        Side of the cells that its moments are merged from [pixel].
    independent : tuple of int
        Bands that vary and do not follow from the others: scores are theirs.
    large : bool
        Too many pixels for what is computed pixel by pixel in long double.
    squares : bool
        False where variances are too small for float64: LAPACK would write its complaints to the terminal.
    """

    name: str
    key: str
    block: Block
    cell: int = 64
    independent: tuple[int, ...] = (0, 1, 2, 3)
    large: bool = False
    squares: bool = True


def sea(rows: int, columns: int, seed: int = 0) -> npt.NDArray[np.float64]:
    """Four bands of water under glint, multiples of 1/64 between 10 and 127."""
    rng = np.random.default_rng(seed)
    glint = rng.gamma(1.0, 8.0, (rows, columns)).clip(0, 60)
    noise = rng.normal(0, 1, (4, rows, columns))
    block = LEVELS[:, None, None] + SLOPES[:, None, None] * glint + noise
    return np.round(block * 64).clip(640, 127 * 64) / 64


def cases(quick: bool) -> Iterator[Case]:
    """All blocks, made one at a time."""
    base = sea(ROWS, COLUMNS)
    yield Case("plain", "plain", base)
    yield Case("offset 1e4", "offset1e4", base + 1e4)
    yield Case("offset 1e8", "offset1e8", base + 1e8)
    yield Case("offset 1e4, float32", "offset1e4float32", (base + 1e4).astype(np.float32))
    yield Case("offset 1e8, float32", "offset1e8float32", (base * 100 + 1e8).astype(np.float32))
    yield Case("scale 1e-12", "scale1e-12", base * 1e-12)
    yield Case("scale 1e12", "scale1e12", base * 1e12)
    yield Case("denormal float32", "denormalfloat32", (base * 1e-42).astype(np.float32))
    yield Case("denormal float64", "denormalfloat64", base * 1e-315, squares=False)
    yield from _of_bands(base)
    yield from _of_pixels(base)
    for dtype in DTYPES:
        yield Case(dtype, dtype, np.rint(base).astype(dtype))
    yield Case("int64, offset 1e18", "int64offset1e18", np.rint(base).astype(np.int64) + 10**18)
    yield Case("64 pixels", "pixels64", base[:, :8, :8].copy())
    yield Case("tiles of 1 pixel", "tiles1", base, cell=1)
    yield Case("1e6 pixels, float32", "pixels1e6", _counts(1000), large=True)
    if not quick:
        yield Case("1e6 pixels in one row", "row1e6", sea(1, 1_000_000, 1).astype(np.float32), large=True)
        yield Case("4e6 pixels, float32", "pixels4e6", _counts(2000), large=True)


def _of_bands(base: npt.NDArray[np.float64]) -> Iterator[Case]:
    """Bands that follow from one another, or do not vary."""
    collinear = base.copy()
    collinear[1] = 2 * base[0] - base[2]
    yield Case("collinear bands", "collinear", collinear, independent=(0, 2, 3))
    nearly = base.copy()
    nearly[1] = base[0] + (base[1] - base[2]) * 2.0**-17
    yield Case("collinear but for 1e-5", "nearlycollinear", nearly)
    constant = base.copy()
    constant[1] = 0.1
    yield Case("a constant band", "constant", constant, independent=(0, 2, 3))


def _of_pixels(base: npt.NDArray[np.float64]) -> Iterator[Case]:
    """Pixels that are not valid, or stray."""
    rng = np.random.default_rng(2)
    for name, value in (("NaN", np.nan), ("infinity", np.inf)):
        dirty = base.copy()
        dirty[2][rng.random(base.shape[1:]) < 0.01] = value
        yield Case(f"1 % {name}", f"one-percent-{name.lower()}", dirty)
    stray = base.copy()
    stray[3, 0, 0] = 1e15
    yield Case("one NIR pixel of 1e15", "extreme1e15", stray)
    stray = base.copy()
    stray[:, 40, 50] = (1e6, 1.1e6, 0.9e6, 1e6)
    yield Case("one pixel of 1e6", "extreme1e6", stray)


def _counts(side: int) -> npt.NDArray[np.float32]:
    """A square of float32 counts with a spread of a hundredth of their mean."""
    return (sea(side, side, 3) + 1000).astype(np.float32)


def digits(found: npt.ArrayLike, right: npt.ArrayLike, scale: npt.ArrayLike | None = None) -> float:
    """Correct digits of the worst value: -log10 of the relative error, 0 to 16; 0 where it is not a number.

    Parameters
    ----------
    found, right : array_like
        What is 0 must be 0, what is NaN must be NaN.
    scale : array_like, optional
        What errors are relative to; `right` by default.
    """
    found, right = np.asarray(found, np.longdouble), np.asarray(right, np.longdouble)
    if found.shape != right.shape:
        return 0.0
    scale = np.abs(right if scale is None else np.asarray(scale, np.longdouble))
    both = np.isnan(found) & np.isnan(right)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        error = np.where((found == right) | both, 0, np.abs(found - right) / scale)
    worst = float(np.max(error, initial=0))
    if math.isnan(worst) or worst >= 1:
        return 0.0
    return 16.0 if worst <= 1e-16 else -math.log10(worst)
