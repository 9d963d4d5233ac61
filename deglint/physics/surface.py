"""Random sea surfaces, computed from a wave spectrum by FFT; waves move according to the dispersion relation.

`realise` draws one surface; `Surface.height` and `Surface.slopes` evaluate it at any time without new random numbers,
so that bands recorded at different times show the same waves. The surface is periodic.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..tiles import Tile, run
from ._checks import Floats
from .spectra import GRAVITY, SURFACE_TENSION, elfouhaily_spread, spreading_norm
from .waves import Sea, omnidirectional, spread_convention

Complex = npt.NDArray[np.complexfloating[Any, Any]]
Seed = int | np.random.SeedSequence | np.random.Generator

SLABS = 16  # parts in which random numbers are drawn, each with its own seed; if this changes, every scene changes


@dataclass(frozen=True, eq=False)
class Surface:
    """One random sea surface on a periodic grid; its height and slopes can be computed at any time."""

    sea: Sea
    spacing: float  # grid step [m]
    amplitudes: Complex = field(repr=False)  # wave amplitudes at time zero [m], (row, column) complex64 in FFT order
    height_variance: float  # expected variance of height on this grid [m2]
    slope_variance: tuple[float, float]  # expected variance of upwind and crosswind slope on this grid [1]

    def height(self, time: float = 0.0, *, workers: int = 1) -> Floats:
        """Height [m] at a time [s], (row, column) float32, row 0 in the north; computed on `workers` threads."""
        return np.ascontiguousarray(self.field(time, slopes=False, workers=workers).real)

    def slopes(self, time: float = 0.0, *, workers: int = 1) -> tuple[Floats, Floats]:
        """Slopes to the east and north [1] at a time [s], (row, column) float32 each; computed on `workers` threads."""
        packed = self.field(time, slopes=True, workers=workers)
        return np.ascontiguousarray(packed.real), np.ascontiguousarray(packed.imag)

    def field(self, time: float, *, slopes: bool, workers: int = 1) -> Complex:
        """East slope + i * north slope [1] if `slopes`, else height [m], at a time [s]: (row, column) complex64."""
        from scipy import fft

        from ._kernels import evolve

        rows, columns = self.amplitudes.shape
        steps = 2 * np.pi / (rows * self.spacing), 2 * np.pi / (columns * self.spacing)
        out = np.empty_like(self.amplitudes)
        physics = SURFACE_TENSION, GRAVITY
        on_rows(lambda *slab: evolve(self.amplitudes, out, slab, steps, time, slopes, physics), rows // 2 + 1, workers)
        return fft.ifft2(out, norm="forward", overwrite_x=True, workers=workers)


def on_rows(work: Callable[[int, int], object], rows: int, workers: int) -> None:
    """Divide the rows 0 to `rows` - 1 into parts, and call work(first row, last row + 1) for each on `workers` threads.

    The division depends on `workers`, so the result of `work` must not depend on the division.
    """
    if workers < 2:
        work(0, rows)
        return
    parts = Tile(0, rows, 0, 1).split(-(-rows // (4 * workers)))
    list(run(parts, lambda part: work(part.row0, part.row1), threads=workers))


def normals(seed: Seed, shape: tuple[int, ...], *, workers: int = 1) -> npt.NDArray[np.float32]:
    """Draw an array of standard normal numbers on `workers` threads; the numbers depend only on `seed` and `shape`."""
    out = np.empty(shape, np.float32)
    if isinstance(seed, np.random.SeedSequence):
        seed = copy(seed)  # a SeedSequence counts its children: the next call would get other numbers
    children = np.random.default_rng(seed).spawn(SLABS)
    edges = np.linspace(0, shape[0], SLABS + 1).astype(int)

    def draw(first: int, last: int) -> None:
        for i in range(first, last):
            children[i].standard_normal(dtype=np.float32, out=out[edges[i] : edges[i + 1]])

    on_rows(draw, SLABS, workers)
    return out


def realise(sea: Sea, *, shape: tuple[int, int], spacing: float, seed: Seed = 0, workers: int = 1) -> Surface:
    """Draw a random sea surface.

    The height at a place x and time t is ``z = sum a(k) exp(i k x - i w t) + complex conjugate``: the sum is over the
    wavenumber vectors k of the grid, in steps dkx and dky, and w is the angular frequency. The amplitudes are
    ``a = (r1 + i r2) sqrt(Psi(k) dkx dky) / 2``, with standard normal r1 and r2 and the wave spectrum Psi [m4]. The
    expected variance of the height is thus exactly the sum of ``Psi dkx dky``.
    Raises InputError if the grid has fewer than 8 x 8 points, if a side of it is shorter than the peak wavelength, or
    if its step is not above 0 m, or exceeds a quarter of the peak wavelength.

    Parameters
    ----------
    sea : Sea
        Wind, wave spectrum and directional spreading.
    shape, spacing : (int, int), float
        Numbers of rows and columns of the grid, and its step [m].
    seed : int, SeedSequence or Generator
        The same seed gives the same surface to the bit, for any `workers`; a Generator gives a new surface each time.
    workers : int
        Number of threads.

    Notes
    -----
    Waves that are longer than the grid, or not resolved by it, are absent. The significant wave height is right to a
    few percent on a grid four peak wavelengths wide; for slopes, one wavelength is enough. A grid point takes 25 bytes.

    References
    ----------
    Tessendorf (2001), Simulating Ocean Water, SIGGRAPH course notes; Mobley (2016), Modeling Sea Surfaces.

    Examples
    --------
    >>> surface = realise(Sea(wind=3.0), shape=(128, 128), spacing=0.25, seed=1)
    >>> east, north = surface.slopes(0.06)
    >>> east.shape
    (128, 128)
    """
    from ._kernels import fill_amplitudes

    _check_grid(sea, shape, spacing)
    rows, columns = shape
    noise = normals(seed, (rows, 2 * columns), workers=workers).view(np.complex64)
    sums = np.zeros((rows, 4))
    steps = 2 * np.pi / (rows * spacing), 2 * np.pi / (columns * spacing)
    table, how = _tables(sea, min(steps), np.pi * np.sqrt(2) / spacing)
    azimuth = np.deg2rad(sea.wind_from)
    along = float(-np.sin(azimuth)), float(-np.cos(azimuth))  # east and north, downwind
    on_rows(lambda *slab: fill_amplitudes(noise, sums, slab, steps, table, how, along), rows, workers)
    height, east2, north2, both = sums.sum(axis=0)
    up = along[0] ** 2 * east2 + along[1] ** 2 * north2 + 2 * along[0] * along[1] * both
    return Surface(sea, spacing, noise, float(height), (float(up), float(east2 + north2 - up)))


def _check_grid(sea: Sea, shape: tuple[int, int], spacing: float) -> None:
    """Raise InputError if a grid of this shape and spacing [m] does not meet the conditions of `realise` for `sea`."""
    peak = sea.peak_wavelength
    if not spacing > 0 or min(shape) < 8:
        raise InputError(f"grid must have a step above 0 m and at least 8 x 8 points, got {spacing:g} m and {shape}")
    if spacing > peak / 4:
        raise InputError(
            f"grid step must be at most {peak / 4:.3g} m, a quarter of the peak wave, got {spacing:g} m;"
            " supersample more, or raise the wind"
        )
    if min(shape) * spacing < peak:
        raise InputError(
            f"grid must span at least one peak wave, {peak:.4g} m or {int(np.ceil(peak / spacing))} points of"
            f" {spacing:g} m, got {min(shape)} points; enlarge it, or lower the wind"
        )


def _tables(sea: Sea, lowest: float, highest: float) -> tuple[tuple[float, float, Floats, Floats], tuple[float, ...]]:
    """Arguments `table` and `how` of `fill_amplitudes` for `sea` and wavenumbers from `lowest` to `highest` [rad/m]."""
    from ._kernels import ELFOUHAILY, FULL_ANGLE, HALF_ANGLE

    logs = np.linspace(np.log(lowest) - 1e-6, np.log(highest) + 1e-6, 8193)
    k = np.exp(logs)
    density = np.log(np.maximum(omnidirectional(k, sea), 1e-300))
    convention = spread_convention(sea)
    if convention == "elfouhaily":
        spread, how = elfouhaily_spread(k, wind=sea.wind), (ELFOUHAILY, 0.0, 0.0, sea.opposing)
    else:
        kind = HALF_ANGLE if convention == "half-angle" else FULL_ANGLE
        spread, how = np.zeros(1), (kind, float(sea.exponent), spreading_norm(sea.exponent, convention), 0.0)
    return (float(logs[0]), float(logs[1] - logs[0]), density, spread), how
