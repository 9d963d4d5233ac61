"""Checks of values against the range of a model; an error names parameter, range, the value given, and a remedy."""

from dataclasses import field, fields
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from ..errors import InputError

Array = npt.NDArray[np.float64]
Floats = npt.NDArray[np.floating[Any]]  # array of single or double precision
VIEW_LIMIT = 89.0
"""Largest view zenith angle [degree]; nearer to the horizon waves shadow each other and the formulas fail."""


def within(name: str, value: npt.ArrayLike, low: float, high: float, unit: str, remedy: str) -> Array:
    """Return `value` as a float64 array if all its elements lie in [low, high]; NaN is allowed.

    `name` of the parameter, `unit` ("" for none) and `remedy`, a sentence, are text for the error message.
    Raises InputError: an element is below `low` or above `high`, or cannot be converted to a number.
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
    """Check that `value` is in [low, high] and not NaN. Arguments are as in `within`. Raises InputError: it is not."""
    if np.isnan(within(name, value, low, high, unit, remedy)).any():
        raise InputError(f"{name} must be a finite number, got {value}; give one.")


def ranged(default: Any, low: float, high: float, unit: str, remedy: str, **more: Any) -> Any:
    """Declare a number field of a `Checked` dataclass with its range [low, high]; None is accepted, NaN is not.

    `default` is MISSING for a required field; `unit` and `remedy` are as in `within`; `more` is further metadata.
    """
    return field(default=default, metadata={"range": (low, high, unit, remedy), **more})


def one_of(default: Any, allowed: Any, **more: Any) -> Any:
    """Declare a `Checked` dataclass field whose value must be in `allowed`; `default` and `more` are as in `ranged`."""
    return field(default=default, metadata={"allowed": allowed, **more})


class Checked:
    """Base of dataclasses: checks each field that is declared with `ranged` or `one_of` when an instance is made.

    Raises InputError: a value is out of its range, is NaN, or is not among the allowed values.
    """

    def __post_init__(self) -> None:
        for own in fields(cast("Any", self)):
            value = getattr(self, own.name)
            if "allowed" in own.metadata:
                choice(own.name, value, own.metadata["allowed"])
            if "range" in own.metadata and value is not None:
                check_number(own.name, value, *own.metadata["range"])


def sun_angle(sun_zenith: npt.ArrayLike) -> Array:
    """Check zenith angles of the sun [degree], return them as float64. Raises InputError: outside 0 to 90."""
    return within("sun_zenith", sun_zenith, 0.0, 90.0, "degrees", "The sun is down; choose another time.")


def view_angle(view_zenith: npt.ArrayLike) -> Array:
    """Check zenith angles of the sensor [degree], return them as float64.

    Raises InputError: outside 0 to `VIEW_LIMIT`; beyond it the formulas of the surface do not hold.
    """
    remedy = "Nearer to the horizon waves hide each other; look more steeply."
    return within("view_zenith", view_zenith, 0.0, VIEW_LIMIT, "degrees", remedy)


def coordinates(latitude: npt.ArrayLike, longitude: npt.ArrayLike) -> tuple[Array, Array]:
    """Check latitude (-90 to 90) and longitude (-180 to 360) [degree], return float64. Raises InputError: outside."""
    remedy = "North is positive. Are latitude and longitude swapped?"
    return within("latitude", latitude, -90.0, 90.0, "degrees", remedy), within(
        "longitude", longitude, -180.0, 360.0, "degrees", "East is positive."
    )


def day_number(day: npt.ArrayLike) -> Array:
    """Check days of the year (1 to 367, with fractions), return them as float64. Raises InputError: out of range."""
    return within("day", day, 1.0, 367.0, "", "Give the day of the year, 1 on the first of January.")


def choice(name: str, value: Any, allowed: Any) -> None:
    """Check that `value` is in `allowed`. Raises InputError: it is not; the message names the parameter `name`."""
    if value not in allowed:
        raise InputError(f"{name} must be one of {', '.join(map(str, allowed))}, got {value!r}. Choose one of these.")
