"""Errors for values outside the range of a model: name, allowed range, value, remedy."""

from dataclasses import field, fields
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from ..errors import InputError

Array = npt.NDArray[np.float64]
Floats = npt.NDArray[np.floating[Any]]
"""Of single or double precision."""
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


def check_number(name: str, value: Any, low: float, high: float, unit: str, remedy: str) -> None:
    """As `within`, but InputError for NaN, too."""
    if np.isnan(within(name, value, low, high, unit, remedy)).any():
        raise InputError(f"{name} must be a finite number, got {value}; give one.")


def ranged(default: Any, low: float, high: float, unit: str, remedy: str, **more: Any) -> Any:
    """A field of a `Checked` dataclass with its range; MISSING for no default. None is allowed, NaN is not."""
    return field(default=default, metadata={"range": (low, high, unit, remedy), **more})


def one_of(default: Any, allowed: Any, **more: Any) -> Any:
    """A field of a `Checked` dataclass with the words that are allowed."""
    return field(default=default, metadata={"allowed": allowed, **more})


class Checked:
    """A dataclass whose fields are checked against their ranges and allowed words.

    Raises InputError: a value is not allowed, or is not a finite number.
    """

    def __post_init__(self) -> None:
        for own in fields(cast("Any", self)):
            value = getattr(self, own.name)
            if "allowed" in own.metadata:
                choice(own.name, value, own.metadata["allowed"])
            if "range" in own.metadata and value is not None:
                check_number(own.name, value, *own.metadata["range"])


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
