"""Shapes of the reflectance of things on the sea: white and grey, and the ways in which paint, plastic and plants
are coloured.

A shape is a spectrum scaled to 1 at its brightest, with how much it may bend: things differ from it by a factor that
is smooth in wavelength, and by a few percent that are not. Made for the bands of a sensor from curves that are edges
and bumps; no measured spectra are needed, because eight bands cannot tell more. Arrays only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from ..errors import InputError

Float64 = npt.NDArray[np.float64]
Curve = Callable[[Float64], Float64]

CENTRE, SPAN = 650.0, 250.0
"""Wavelength [nm] that bends are counted from, and in units of what."""
DARK = 0.07
"""Reflectance of a coloured thing where it is dark, against where it is bright."""
EDGE, BUMP = 15.0, 12.0
"""Softness of the edges [nm]."""
RISES = (470, 500, 530, 560, 590, 605, 620, 650, 690, 720, 750)
"""Yellow, orange, red, and what is bright in the near infrared only: where the reflectance rises [nm]."""
FALLS = (470, 490, 510, 530, 560, 590, 620)
"""Blue and cyan: where it falls [nm]."""
BUMPS = ((480, 530), (500, 560), (510, 590), (450, 510))
"""Green: where it rises and falls [nm]."""
VALLEYS = tuple((fall, rise) for fall in (490, 510, 540, 580) for rise in (690, 730))
"""Dyes that are clear in the near infrared: where it falls and rises again [nm]."""
ODD_ONE_OUT = 0.1
"""Share of grey things that sparkle nearby spoils in one band."""


@dataclass(frozen=True, slots=True)
class Shapes:
    """A mixture of shapes, (shape, band) or one number a shape.

    Attributes
    ----------
    values : (shape, band) ndarray
        Reflectance over that of the brightest band.
    slope, bend : (shape,) ndarray
        Standard deviation of the linear and of the quadratic factor, per `SPAN`.
    rough : (shape,) ndarray
        Standard deviation of what is not smooth, as a share of the value.
    odd : (shape,) ndarray of int
        Band that says nothing, or -1.
    weight : (shape,) ndarray
        How common it is; they sum to 1.
    """

    values: Float64
    slope: Float64
    bend: Float64
    rough: Float64
    odd: npt.NDArray[np.int64]
    weight: Float64


def shapes(wavelength: Sequence[float], width: Sequence[float]) -> Shapes:
    """Shapes as the bands of a sensor see them.

    Parameters
    ----------
    wavelength, width : sequence of float
        Centre and full width of the bands [nm].

    Returns
    -------
    Shapes
        Half the weight is grey (flat), the rest is shared by the coloured shapes, and grey with any one band spoiled.

    Raises
    ------
    InputError
        Not as many widths as wavelengths, or one that is not positive.

    Examples
    --------
    >>> found = shapes([450.0, 550.0, 660.0, 830.0], [60.0, 60.0, 60.0, 100.0])
    >>> found.values.shape[1], round(float(found.weight.sum()), 12)
    (4, 1.0)
    """
    if len(wavelength) != len(width) or not (np.asarray([*wavelength, *width]) > 0).all():
        raise InputError(f"wavelengths and widths must be positive and as many, got {list(wavelength)}, {list(width)}")
    bands = [np.linspace(w - d / 2, w + d / 2, 33) for w, d in zip(wavelength, width, strict=True)]

    def seen(curve: Curve) -> Float64:
        values = np.array([DARK + (1 - DARK) * float(curve(b).mean()) for b in bands])
        return values / values.max()

    coloured = [seen(partial(_edges, rise=a)) for a in RISES]
    coloured += [seen(partial(_edges, fall=a)) for a in FALLS]
    coloured += [seen(partial(_bump, rise=a, fall=b)) for a, b in BUMPS]
    coloured += [seen(partial(_edges, fall=a, rise=b)) for a, b in VALLEYS]
    coloured.append(seen(_plants))
    count, several = len(bands), len(coloured)
    grey = np.ones((1 + count, count))
    weight = np.r_[0.5, np.full(count, 0.5 * ODD_ONE_OUT / count), np.full(several, 0.5 / several)]
    return Shapes(
        values=np.vstack([grey, np.array(coloured)]),
        slope=np.r_[np.full(1 + count, 0.25), np.full(several, 0.15)],
        bend=np.r_[np.full(1 + count, 0.15), np.zeros(several)],
        rough=np.r_[np.full(1 + count, 0.05), np.full(several, 0.08)],
        odd=np.r_[-1, np.arange(count), np.full(several, -1)].astype(np.int64),
        weight=weight / weight.sum(),
    )


def _rise(x: Float64, at: float, softness: float) -> Float64:
    return np.asarray(1 / (1 + np.exp(-(x - at) / softness)))


def _edges(x: Float64, rise: float = np.inf, fall: float = -np.inf) -> Float64:
    """Bright beyond the one and up to the other."""
    return _rise(x, rise, EDGE) + _rise(-x, -fall, EDGE)


def _bump(x: Float64, rise: float, fall: float) -> Float64:
    return _rise(x, rise, BUMP) * _rise(-x, -fall, BUMP)


def _plants(x: Float64) -> Float64:
    return 0.1 * np.exp(-0.5 * ((x - 550) / 30) ** 2) + 0.9 * _rise(x, 715, 10.0)
