"""Small text files given by the user: GeoJSON, saved models."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import InputError, ReadError
from ..raster.files import check_kind

MOST_TEXT_BYTES = 64 << 20
"""Largest file that is read [byte]."""
MOST_TOML_BYTES = 1 << 20
"""Largest TOML file that is read [byte]."""


def read_text(path: str, option: str, most: int | None = None) -> str:
    """Text of a file given by an option, of at most `most` bytes (`MOST_TEXT_BYTES` by default)."""
    most = MOST_TEXT_BYTES if most is None else most
    check_kind(path)
    try:
        with Path(path).open("rb") as file:
            data = file.read(most + 1)
    except FileNotFoundError as error:
        raise ReadError(f"no such file: {path} ({option}). Check the name.") from error
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise ReadError(f"cannot read {path} ({option}): {why}. Name a file that can be read.") from error
    if len(data) > most:
        raise InputError(f"{path} ({option}) is larger than {most >> 20} MB; give a smaller file.")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} ({option}) is not a text file: it is not UTF-8.") from error


def read_toml(path: str, option: str) -> dict[str, Any]:
    """The tables in a TOML file given by an option; errors as `read_text`."""
    import tomllib

    text = read_text(path, option, MOST_TOML_BYTES)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # numbers of thousands of digits are no TOMLDecodeError
        raise InputError(f"{path} ({option}) is not TOML: {str(error) or 'it is nested too deep'}.") from error


def read_json(path: str, option: str) -> Mapping[str, Any]:
    """The object in a JSON file given by an option; errors as `read_text`."""
    try:
        document = json.loads(read_text(path, option))
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path} ({option}) is not JSON: {error}. Save it again.") from error
    if not isinstance(document, Mapping):
        raise InputError(f"{path} ({option}) does not hold a JSON object. Save it again.")
    return document
