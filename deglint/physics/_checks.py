"""Checks of parameters; each error message has the parameter's name, what is allowed, the given value and a remedy."""

from collections.abc import Iterable
from dataclasses import Field, field, fields
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from ..checks import check_choice
from ..errors import InputError

Array = npt.NDArray[np.float64]
Floats = npt.NDArray[np.floating[Any]]  # array of single or double precision
VIEW_LIMIT = 89.0
"""Largest view zenith angle [degree]; nearer to the horizon waves shadow each other and the formulas fail."""


def within(name: str, value: npt.ArrayLike, low: float, high: float, unit: str, remedy: str) -> Array:
    """Return `value` as a float64 array if all its elements lie in [low, high]; NaN is allowed.

    The error message has the `name` of the parameter, the `unit` of its range ("" for none), and `remedy`, a sentence.
    Raises InputError if an element is below `low` or above `high`, or cannot be converted to a number.
    """
    unit = f" {unit}" if unit else ""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be numbers in {low:g} to {high:g}{unit}, got {value!r}. {remedy}") from None
    bad = (array < low) | (array > high)
    if np.any(bad):
        raise InputError(f"{name} must be {low:g} to {high:g}{unit}, got {array[bad].flat[0]:g}. {remedy}")
    return array


def check_quantity(name: str, value: npt.ArrayLike, low: float, high: float, unit: str, remedy: str) -> None:
    """Raise InputError unless `value` is one number in [low, high] and not NaN; other arguments are as in `within`."""
    array = within(name, value, low, high, unit, remedy)
    if isinstance(value, (str, bytes)) or array.ndim or np.isnan(array):
        raise InputError(f"{name} must be a finite number, got {value!r}; give one.")


def ranged(default: object, low: float, high: float, unit: str, remedy: str, **more: object) -> Any:
    """Make a field of a `Checked` dataclass whose value must be a number in [low, high], or None; NaN is not allowed.

    `default` is MISSING for a required field. If `default` is a tuple of n numbers, the value must have n numbers, each
    in [low, high]. `unit` and `remedy` are as in `within`. `more` is further metadata of the field; with
    ``integer=True``, the value must be an integer.
    """
    return field(default=default, metadata={"range": (low, high, unit, remedy), **more})


def one_of(default: object, allowed: Iterable[object], **more: object) -> Any:
    """Make a `Checked` dataclass field whose value must be in `allowed`; `default` and `more` are as in `ranged`."""
    return field(default=default, metadata={"allowed": allowed, **more})


class Checked:
    """Base class of dataclasses whose fields, if made by `ranged` or `one_of`, are checked when an instance is made.

    Raises InputError if a value is not allowed. Values of fields made by `ranged` are converted to Python numbers.
    """

    def __post_init__(self) -> None:
        for own in fields(cast("Any", self)):
            value = getattr(self, own.name)
            if "allowed" in own.metadata and not (value is None and None in own.metadata["allowed"]):
                check_choice(value, [word for word in own.metadata["allowed"] if word], own.name)
            if "range" in own.metadata and value is not None:
                object.__setattr__(self, own.name, _ranged_value(own, value, own.default))


def _ranged_value(own: Field[Any], value: Any, default: object) -> object:
    """Check the value of a field `own` made by `ranged`; return a Python number, or a tuple if `default` is a tuple."""
    if isinstance(default, tuple):
        if np.shape(value) != np.shape(default):
            raise InputError(f"{own.name} must be {len(default)} numbers, got {value!r}; give as many.")
        return tuple(_ranged_value(own, number, None) for number in value)
    check_quantity(own.name, value, *own.metadata["range"])
    number = np.asarray(value).item()
    if own.metadata.get("integer") and number != round(number):
        raise InputError(f"{own.name} must be an integer, got {number:g}. Round it.")
    return round(number) if own.metadata.get("integer") else number


def sun_angle(sun_zenith: npt.ArrayLike) -> Array:
    """Return zenith angles of the sun [degree] as float64; raise InputError if one of them is outside 0 to 90."""
    return within("sun_zenith", sun_zenith, 0.0, 90.0, "degrees", "Give a sun that is up.")


def view_angle(view_zenith: npt.ArrayLike) -> Array:
    """Return zenith angles of the sensor [degree] as float64; raise InputError if one is outside 0 to `VIEW_LIMIT`."""
    remedy = "Waves shadow each other there; choose a smaller zenith angle."
    return within("view_zenith", view_zenith, 0.0, VIEW_LIMIT, "degrees", remedy)


def coordinates(latitude: npt.ArrayLike, longitude: npt.ArrayLike) -> tuple[Array, Array]:
    """Return latitude and longitude [degree] as float64.

    Raises InputError if a latitude is outside -90 to 90 degrees, or a longitude outside -180 to 360 degrees.
    """
    remedy = "North is positive. Are latitude and longitude swapped?"
    north = within("latitude", latitude, -90.0, 90.0, "degrees", remedy)
    return north, within("longitude", longitude, -180.0, 360.0, "degrees", "East is positive.")


def day_number(day: npt.ArrayLike) -> Array:
    """Return days of the year (fractions are allowed) as float64; raise InputError if one is outside 1 to 367."""
    return within("day", day, 1.0, 367.0, "", "Give the day of the year, 1 on the first of January.")
