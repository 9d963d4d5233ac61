"""Correct digits of moments, slopes and RX scores, in deglint and other programs, on images that are hard to compute.

The reference is computed in long double by two passes. On x86-64 that leaves 16 sure digits after a million additions.
`python -m benchmarks stress`.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt

from deglint import remove
from deglint.errors import DeglintError
from deglint.moments import cell_moments
from detect.background import fit
from detect.global_rx import detector, score
from detect.local import local_rx

from .timing import say

Block = npt.NDArray[Any]
Wide = npt.NDArray[np.longdouble]
WIDE = np.finfo(np.longdouble).nmant >= 63
"""Whether a long double is more than a double on this machine."""
NIR_BAND = 3
DTYPES = ("uint8", "int16", "uint16", "float16", "float32")
INNER, OUTER = 3, 11
"""Windows of local RX [pixel]."""
PLACES = np.argwhere(np.ones((12, 12), np.bool_))[::7] + OUTER // 2
"""Pixels (row, column) whose local scores are compared; not all, because spectral is slow."""
CORNER = 24
"""Side of the part of the image in which spectral computes local RX [pixel]."""


@dataclass(frozen=True, eq=False)
class HardCase:
    """An image (band, row, column). `independent` bands vary and do not follow from others; references use these."""

    name: str
    block: Block
    independent: tuple[int, ...] = (0, 1, 2, 3)

    @cached_property
    def pixels(self) -> Wide:
        """Values (band, pixel) of the pixels that are finite in every band."""
        flat = self.block.reshape(len(self.block), -1)
        return np.asarray(flat[:, np.isfinite(flat).all(axis=0)], np.longdouble)


def sea(rows: int, columns: int, seed: int = 0) -> npt.NDArray[np.float64]:
    """Four bands of water under glint, multiples of 1/64 between 10 and 127; the last band is the NIR."""
    rng = np.random.default_rng(seed)
    glint = rng.gamma(1.0, 8.0, (rows, columns)).clip(0, 60)
    noise = rng.normal(0, 1, (4, rows, columns))
    levels, slopes = np.array([60.0, 50.0, 30.0, 20.0]), np.array([0.9, 0.8, 0.5, 1.0])
    block = levels[:, None, None] + slopes[:, None, None] * glint + noise
    return np.round(block * 64).clip(640, 127 * 64) / 64


def cases() -> Iterator[HardCase]:
    """All cases, made one at a time."""
    base = sea(96, 104)
    yield HardCase("plain", base)
    yield HardCase("offset 1e8", base + 1e8)
    yield HardCase("offset 1e4, float32", (base + 1e4).astype(np.float32))
    yield HardCase("scale 1e-12", base * 1e-12)
    yield HardCase("scale 1e12", base * 1e12)
    yield HardCase("denormal float32", (base * 1e-42).astype(np.float32))
    collinear, nearly, constant = base.copy(), base.copy(), base.copy()
    collinear[1] = 2 * base[0] - base[2]
    yield HardCase("collinear bands", collinear, (0, 2, 3))
    nearly[1] = base[0] + (base[1] - base[2]) * 2.0**-17
    yield HardCase("collinear but for 1e-5", nearly)
    constant[1] = 0.1
    yield HardCase("a constant band", constant, (0, 2, 3))
    dirty, stray, bright = base.copy(), base.copy(), base.copy()
    dirty[2][np.random.default_rng(2).random(base.shape[1:]) < 0.01] = np.nan
    yield HardCase("1 % NaN", dirty)
    stray[3, 0, 0] = 1e15
    yield HardCase("one NIR pixel of 1e15", stray)
    bright[:, 40, 50] = (1e6, 1.1e6, 0.9e6, 1e6)
    yield HardCase("one pixel of 1e6", bright)
    for dtype in DTYPES:
        yield HardCase(dtype, np.rint(base).astype(dtype))
    yield HardCase("1e6 pixels, float32", (sea(1000, 1000, 3) + 1000).astype(np.float32))


def mean_and_covariance(x: Wide) -> tuple[Wide, Wide]:
    """Mean (band,) and covariance (band, band) of values (band, pixel)."""
    mean = x.mean(axis=1)
    away = x - mean[:, None]
    left = away.mean(axis=1)
    away -= left[:, None]
    products = [[(a * b).sum() for b in away] for a in away]
    return mean + left, np.array(products, np.longdouble) / (x.shape[1] - 1)


def distances(x: Wide, sample: Wide) -> Wide:
    """Squared Mahalanobis distances of pixels `x`, (band, pixel), from the mean of a sample, by elimination."""
    unit = np.ldexp(np.ones(len(x), np.longdouble), np.frexp(np.abs(sample - sample[:, :1]).max(axis=1))[1])
    first = sample[:, :1].copy()  # powers of two as units and the first pixel as origin: nothing is rounded
    mean, matrix = mean_and_covariance((sample - first) / unit[:, None])
    rest = (x - first) / unit[:, None] - mean[:, None]
    total = np.zeros(x.shape[1], np.longdouble)
    for i in range(len(matrix)):
        total += rest[i] * rest[i] / matrix[i, i]
        share = matrix[i + 1 :, i] / matrix[i, i]
        rest[i + 1 :] -= share[:, None] * rest[i]
        matrix[i + 1 :, i + 1 :] -= share[:, None] * matrix[i, i + 1 :]
    return total


def rx_scores(case: HardCase) -> Wide:
    """Reference RX score of every pixel; NaN where a band is not finite."""
    flat = case.block.reshape(len(case.block), -1)
    out = np.full(flat.shape[1], np.nan, np.longdouble)
    chosen = case.pixels[list(case.independent)]
    out[np.isfinite(flat).all(axis=0)] = distances(chosen, chosen)
    return out.reshape(case.block.shape[1:])


def local_scores(case: HardCase) -> Wide:
    """Reference local RX scores at `PLACES`: each pixel is compared with the ring around it."""
    ring = np.ones((OUTER, OUTER), np.bool_)
    guard = slice(OUTER // 2 - INNER // 2, OUTER // 2 + INNER // 2 + 1)
    ring[guard, guard] = False
    found, half, bands = [], OUTER // 2, list(case.independent)
    for row, column in PLACES:
        part = case.block[:, row - half : row + half + 1, column - half : column + half + 1]
        window = np.asarray(part, np.longdouble)
        sample, own = window[:, ring][bands], window[bands, half, half][:, None]
        finite = np.isfinite(window).all(axis=0)
        found.append(distances(own, sample[:, finite[ring]])[0] if finite[half, half] else np.nan)
    return np.array(found, np.longdouble)


def slopes(case: HardCase) -> Wide:
    """Reference slope (least squares) of every other band on the NIR."""
    _, covariance = mean_and_covariance(case.pixels / np.abs(case.pixels).max())
    return np.asarray(covariance[:NIR_BAND, NIR_BAND] / covariance[NIR_BAND, NIR_BAND])


def references(case: HardCase) -> dict[str, tuple[Wide, Wide]]:
    """For every operation its reference, and the values to which its errors are relative."""
    mean, covariance = mean_and_covariance(case.pixels)
    slope, scores, local = slopes(case), rx_scores(case), local_scores(case)
    least = len(case.independent)  # scores near 0 are compared with the mean score
    return {"mean": (mean, mean), "covariance": (covariance, covariance), "slope": (slope, slope),
            "RX": (scores, np.fmax(scores, least)), "local RX": (local, np.fmax(local, least))}  # fmt: skip


def digits(found: npt.ArrayLike, right: npt.ArrayLike, scale: npt.ArrayLike | None = None) -> float:
    """Correct digits of the worst value, 0 to 16: -log10 of the error relative to `scale`; 0 for a wrong NaN."""
    found, right = np.asarray(found, np.longdouble), np.asarray(right, np.longdouble)
    if found.shape != right.shape:
        return 0.0
    size = np.abs(right if scale is None else np.asarray(scale, np.longdouble))
    both = np.isnan(found) & np.isnan(right)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        error = np.where((found == right) | both, 0, np.abs(found - right) / size)
    worst = float(np.max(error, initial=0))
    if math.isnan(worst) or worst >= 1:
        return 0.0
    return 16.0 if worst <= 1e-16 else -math.log10(worst)


Jobs = dict[str, Callable[[], Any]]


def by_deglint(case: HardCase) -> Jobs:
    """Operations of deglint and detect, by name, as functions of no argument."""
    block = case.block
    physical = block if block.dtype in (np.float32, np.float64) else block.astype(np.float64)  # as readers return it
    moments = cell_moments(block, cell=64).total()
    return {
        "mean": lambda: moments.mean,
        "covariance": moments.covariance,
        "slope": lambda: [f.slope for f in remove.fit("lyzenga", physical, nir=NIR_BAND).fits],
        "RX": lambda: score(block, detector("rx", fit(block))),
        "local RX": lambda: local_rx(block, inner=INNER, outer=OUTER)[tuple(PLACES.T)],
    }


def by_numpy(case: HardCase) -> Jobs:
    """The same operations by numpy.cov and numpy.polyfit."""
    flat = case.block.reshape(len(case.block), -1)
    return {"mean": lambda: flat.mean(axis=1), "covariance": lambda: np.cov(flat),
            "slope": lambda: [np.polyfit(flat[NIR_BAND], band, 1)[0] for band in flat[:NIR_BAND]]}  # fmt: skip


def by_sklearn(case: HardCase) -> Jobs:
    """The same operations by EmpiricalCovariance and LinearRegression of scikit-learn."""
    from sklearn.covariance import EmpiricalCovariance
    from sklearn.linear_model import LinearRegression

    pixels = np.ascontiguousarray(case.block.reshape(len(case.block), -1).T)
    more, shape = len(pixels) / (len(pixels) - 1), case.block.shape[1:]

    def fitted() -> Any:
        return EmpiricalCovariance().fit(pixels)

    return {
        "mean": lambda: fitted().location_,
        "covariance": lambda: fitted().covariance_ * more,
        "slope": lambda: LinearRegression().fit(pixels[:, NIR_BAND:], pixels[:, :NIR_BAND]).coef_[:, 0],
        "RX": lambda: (fitted().mahalanobis(pixels) / more).reshape(shape),
    }


def by_spectral(case: HardCase) -> Jobs:
    """The same operations by calc_stats and rx of spectral."""
    import spectral

    spectral.settings.show_progress = False
    image = np.ascontiguousarray(case.block.transpose(1, 2, 0))
    corner = image[:CORNER, :CORNER]
    return {
        "mean": lambda: spectral.calc_stats(image).mean,
        "covariance": lambda: spectral.calc_stats(image).cov,
        "RX": lambda: spectral.rx(image),
        "local RX": lambda: spectral.rx(corner, window=(INNER, OUTER))[tuple(PLACES.T)],
    }


PROGRAMS = {"deglint": by_deglint, "numpy": by_numpy, "scikit-learn": by_sklearn, "spectral": by_spectral}


def measure(case: HardCase) -> dict[str, dict[str, float | None]]:
    """Correct digits by operation and program; None where a program refuses the case."""
    found: dict[str, dict[str, float | None]] = {}
    refused = (DeglintError, ValueError, TypeError, ArithmeticError, IndexError, NotImplementedError)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        right = references(case)
        for program, jobs in PROGRAMS.items():
            if program == "spectral" and not find_spec("spectral"):
                continue
            for operation, job in jobs(case).items():
                try:
                    value = digits(job(), *right[operation])
                except refused:
                    value = None
                found.setdefault(operation, {})[program] = value
    return found


def rows() -> tuple[list[str], list[list[str]]]:
    """Head and rows of the table. A row is a case, a column an operation; a cell has the digits of all programs."""
    body, head = [], [""]
    for case in cases():
        found = measure(case)
        cells = [" / ".join("-" if d is None else f"{d:.0f}" for d in own.values()) for own in found.values()]
        head = ["", *(f"{operation}: {' / '.join(own)}" for operation, own in found.items())]
        body.append([case.name, *cells])
    return head, body


DIGITS_NOTE = (
    "Correct digits of the worst value, -log10 of its relative error, rounded; '-': the program refuses. float64 holds "
    "16 digits. Scores of images that are not float64 are float32, which holds 7. A covariance loses as many digits as "
    "its condition number has."
)


def main() -> None:
    """Print the table."""
    more = "" if WIDE else " A long double is a double here: 13 digits are sure."
    say("Correct digits", *rows(), DIGITS_NOTE + more)
