"""Small text files given by the user, such as GeoJSON, and numbers in texts."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import InputError, ReadError


def read_text(path: str, option: str) -> str:
    """Text of a UTF-8 file given by an option; ReadError or InputError if it cannot be read."""
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise ReadError(f"no such file: {path} ({option}). Check the name.") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} ({option}) is not a text file: it is not UTF-8.") from error
    except OSError as error:
        raise ReadError(f"cannot read {path} ({option}): {error.strerror}. Name a file that can be read.") from error


def read_toml(path: str, option: str) -> dict[str, Any]:
    """The tables in a TOML file given by an option; InputError if it is not TOML, else errors as in `read_text`."""
    import tomllib

    text = read_text(path, option)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of thousands of digits raises a plain ValueError
        raise InputError(f"{path} ({option}) is not TOML: {str(error) or 'it is nested too deep'}.") from error


def read_json(path: str, option: str) -> Mapping[str, Any]:
    """The object in a JSON file given by an option; InputError if it has none, else errors as in `read_text`."""
    text = read_text(path, option)
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} ({option}) is not JSON: {error}. Save it again.") from error
    if not isinstance(document, Mapping):
        raise InputError(f"{path} ({option}) does not hold a JSON object. Save it again.")
    return document


def number(value: Any) -> float | None:
    """The value as a float if it is a finite number or the text of one, else None."""
    try:
        found = float(value)
    except (TypeError, ValueError):
        return None
    return found if math.isfinite(found) else None


def positive(value: Any) -> float | None:
    """The value as a float if it is a finite number above 0 or the text of one, else None."""
    found = number(value)
    return found if found is not None and found > 0 else None


def numbers(text: str | None) -> list[float]:
    """The numbers in a text, which are separated by blanks or commas; an empty list if a part is not a number."""
    found = [number(part) for part in (text or "").replace(",", " ").split()]
    return [] if None in found else [n for n in found if n is not None]
