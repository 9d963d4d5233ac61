"""Errors for values outside the range of a model: name, allowed range, value, remedy."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import InputError

Array = npt.NDArray[np.float64]


def within(name: str, value: npt.ArrayLike, low: float, high: float, unit: str, remedy: str) -> Array:
    """The value as float64, NaN kept; InputError if it lies outside [low, high].

    Raises
    ------
    InputError
        A value is below `low` or above `high`, or is not a number.
    """
    unit = f" {unit}" if unit else ""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be numbers in {low:g} to {high:g}{unit}, got {value!r}. {remedy}") from None
    bad = (array < low) | (array > high)
    if np.any(bad):
        worst = float(array[bad].flat[0]) if array.ndim else float(array)
        raise InputError(f"{name} must be {low:g} to {high:g}{unit}, got {worst:g}. {remedy}")
    return array


def choice(name: str, value: Any, allowed: Any) -> None:
    """Check that a value is one of those allowed.

    Raises
    ------
    InputError
        The value is not among them.
    """
    if value not in allowed:
        raise InputError(f"{name} must be one of {', '.join(map(str, allowed))}, got {value!r}. Choose one of these.")
