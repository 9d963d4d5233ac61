"""Read small files that a user names in options (TOML, JSON, GeoJSON, CSV), and convert strings to numbers."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import InputError, ReadError


def read_text(path: str, option: str) -> str:
    """Read a UTF-8 file; messages name the command-line option `option`. Raises ReadError or InputError on failure."""
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise ReadError(f"no such file: {path} ({option}). Check the name.") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} ({option}) is not a text file: it is not UTF-8.") from error
    except OSError as error:
        raise ReadError(f"cannot read {path} ({option}): {error.strerror}. Name a file that can be read.") from error


def read_toml(path: str, option: str) -> dict[str, Any]:
    """Read a TOML file; messages name the command-line option `option`. Raises ReadError or InputError on failure."""
    import tomllib

    text = read_text(path, option)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of thousands of digits raises a plain ValueError
        raise InputError(f"{path} ({option}) is not TOML: {str(error) or 'it is nested too deep'}.") from error


def read_json(path: str, option: str) -> Mapping[str, Any]:
    """Read the JSON object in a file; messages name the option `option`. Raises ReadError or InputError on failure."""
    text = read_text(path, option)
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} ({option}) is not JSON: {error}. Save it again.") from error
    if not isinstance(document, Mapping):
        raise InputError(f"{path} ({option}) does not hold a JSON object. Save it again.")
    return document


def number(value: Any) -> float | None:
    """The value as a float if it is a finite number, or a string with such a number; else None."""
    try:
        found = float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return found if math.isfinite(found) else None


def positive(value: Any) -> float | None:
    """The value as a float if it is a finite number above 0, or a string with such a number; else None."""
    found = number(value)
    return found if found is not None and found > 0 else None


def numbers(text: str | None) -> list[float]:
    """The numbers in a string, separated by blanks or commas; an empty list if any part of it is not a number."""
    found = [number(part) for part in (text or "").replace(",", " ").split()]
    return [] if None in found else [n for n in found if n is not None]
