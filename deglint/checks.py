"""Checks of arguments of public functions: each error names the argument, the allowed values and the given value."""

import difflib
import inspect
import os
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import wraps
from numbers import Real
from types import UnionType
from typing import Any, ParamSpec, TypeVar, cast, get_args, get_origin, get_type_hints

from .errors import InputError

Args = ParamSpec("Args")
T = TypeVar("T")


def nearest(word: str, known: list[str]) -> str:
    """Suggestion "; did you mean X?" if a known word is similar to `word`, but not equal to it; else an empty string.

    >>> nearest("hedly", ["hedley", "joyce"]), nearest("magic", ["hedley", "joyce"]), nearest("nir", ["nir"])
    ("; did you mean 'hedley'?", '', '')
    """
    found = difflib.get_close_matches(word.lower(), [k for k in known if k != word], 1, 0.6)
    return f"; did you mean {found[0]!r}?" if found else ""


def checked_keywords(*more: str) -> Callable[[Callable[Args, T]], Callable[Args, T]]:
    """Make a decorator that raises TypeError for an unknown keyword; the message names a similar one, or lists all.

    `more` are keywords that the function accepts through ``**``.
    """

    def decorate(function: Callable[Args, T]) -> Callable[Args, T]:
        parameters = inspect.signature(function).parameters.values()
        known = [p.name for p in parameters if p.name != "self" and p.kind is not p.VAR_KEYWORD] + list(more)

        @wraps(function)
        def call(*args: Args.args, **kwargs: Args.kwargs) -> T:
            if unknown := kwargs.keys() - {*known}:
                word, name = min(unknown), function.__qualname__.removesuffix(".__init__")
                hint = nearest(word, known) or f"; it takes {', '.join(known)}."
                raise TypeError(f"{name}: there is no argument {word!r}{hint}")
            return function(*args, **kwargs)

        return call

    return decorate


def described(value: object) -> str:
    """Describe a value by a short text for an error message; an array is described by its shape.

    >>> described("a.tif"), described(7), described([1] * 99)
    ("'a.tif'", '7', 'a list of 99')
    """
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return f"an array of shape {tuple(value.shape)}"
    if isinstance(value, (list, tuple, dict, set)) and len(value) > 4:
        return f"a {type(value).__name__} of {len(value)}"
    if isinstance(value, (str, int, float, list, tuple, os.PathLike)) or value is None:
        return f"{value!r:.80}"
    return f"a {type(value).__name__}"


def as_path(value: object, name: str) -> str:
    """Return `value`, of the argument `name`, as text; raise InputError if it is no path or GDAL name, or is empty."""
    if isinstance(value, str) and value:
        return value
    if isinstance(value, os.PathLike) and isinstance(path := os.fspath(value), str):
        return path
    hint = " Arrays go to deglint.fit and deglint.apply." if hasattr(value, "dtype") else ""
    raise InputError(f"{name}: want a file name, got {described(value)}.{hint}")


def check_kind(value: object, kind: type, name: str, remedy: str) -> None:
    """Raise InputError if `value`, of the argument `name`, is not of the type `kind`; `remedy` ends the message."""
    if not isinstance(value, kind):
        raise InputError(f"{name}: want a {'text' if kind is str else kind.__name__}, got {described(value)}. {remedy}")


def check_choice(value: object, known: list[str], name: str) -> None:
    """Raise InputError, which lists the words in `known`, if `value`, of the argument `name`, is not one of them."""
    if not isinstance(value, str) or value not in known:
        hint = nearest(value, known) if isinstance(value, str) else ""
        raise InputError(f"{name} {described(value)} is not one of {', '.join(known)}{hint or '.'}")


def check_number(value: object, low: float, high: float, name: str) -> None:
    """Raise InputError if `value`, of the argument `name`, is not a number from `low` to `high`."""
    try:
        inside = isinstance(value, Real) and not isinstance(value, bool) and low <= float(value) <= high
    except OverflowError:
        raise InputError(
            f"{name}: want a number from {low:g} to {high:g}, got an integer beyond double precision."
        ) from None
    if not inside:
        raise InputError(f"{name}: want a number from {low:g} to {high:g}, got {described(value)}.")


def from_plain(kind: Any, value: object) -> Any:
    """Convert a JSON or TOML value to the type `kind`: dicts to dataclasses, lists to tuples; unknown keys are ignored.

    Raises TypeError or ValueError if the value cannot be converted, or if a required field is missing.
    """
    origin, inner = get_origin(kind), get_args(kind)
    if origin is UnionType:  # X | None
        return None if value is None else from_plain(inner[0], value)
    if is_dataclass(kind) and isinstance(value, dict):
        make, types = cast("Any", kind), get_type_hints(kind)
        return make(**{f.name: from_plain(types[f.name], value[f.name]) for f in fields(kind) if f.name in value})
    if origin is tuple and isinstance(value, list):
        each = inner[:1] * len(value) if inner[-1] is Ellipsis else inner
        return tuple(from_plain(k, v) for k, v in zip(each, value, strict=True))
    if kind is float and type(value) is int:
        return float(value)
    if type(value) is not kind:
        raise TypeError(f"{described(value)} is not of the type {kind}")
    return value
