"""Errors for values outside the range of a model: name, allowed range, value, remedy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import InputError

Array = npt.NDArray[np.float64]
Floats = npt.NDArray[np.floating[Any]]
"""Of single or double precision."""
Range = tuple[float, float, str, str]
"""Lowest and highest value, unit, and remedy."""
VIEW_LIMIT = 89.0
"""Largest view zenith angle [degree]; nearer to the horizon waves shadow each other and the formulas fail."""


def within(name: str, value: npt.ArrayLike, low: float, high: float, unit: str, remedy: str) -> Array:
    """The value as float64, NaN kept; InputError if it lies outside [low, high].

    Raises InputError: a value is below `low` or above `high`, or is not a number.
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


def check_fields(values: object, ranges: Mapping[str, Range]) -> None:
    """Check the fields of a dataclass that have a range; None is allowed.

    Raises InputError: a value lies outside its range, or is not a finite number.
    """
    for name, limits in ranges.items():
        value = getattr(values, name)
        if value is not None and np.isnan(within(name, value, *limits)).any():
            raise InputError(f"{name} must be a finite number, got {value}; give one.")


def sun_angle(sun_zenith: npt.ArrayLike) -> Array:
    """Zenith angle of the sun above the horizon [degree]."""
    return within("sun_zenith", sun_zenith, 0.0, 90.0, "degrees", "The sun is down; choose another time.")


def view_angle(view_zenith: npt.ArrayLike) -> Array:
    """Zenith angle of the sensor, where the formulas of the surface hold [degree]."""
    remedy = "Nearer to the horizon waves hide each other; look more steeply."
    return within("view_zenith", view_zenith, 0.0, VIEW_LIMIT, "degrees", remedy)


def coordinates(latitude: npt.ArrayLike, longitude: npt.ArrayLike) -> tuple[Array, Array]:
    """Latitude and longitude [degree]."""
    remedy = "North is positive. Are latitude and longitude swapped?"
    return within("latitude", latitude, -90.0, 90.0, "degrees", remedy), within(
        "longitude", longitude, -180.0, 360.0, "degrees", "East is positive."
    )


def day_number(day: npt.ArrayLike) -> Array:
    """Day of the year."""
    return within("day", day, 1.0, 367.0, "", "Give the day of the year, 1 on the first of January.")


def choice(name: str, value: Any, allowed: Any) -> None:
    """Check that a value is one of those allowed.

    Raises InputError: the value is not among them.
    """
    if value not in allowed:
        raise InputError(f"{name} must be one of {', '.join(map(str, allowed))}, got {value!r}. Choose one of these.")
