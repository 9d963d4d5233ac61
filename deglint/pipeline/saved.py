"""Saved fits: the model of the removal, and the compensation around it, in one JSON file."""

from __future__ import annotations

import json

from ..compensate2.stages import Chain, chain_from
from ..errors import InputError
from ..readers.text import read_text
from ..remove import GlintModel
from .fit import Fitted


def saved(fitted: Fitted) -> str:
    """A fit as JSON text (what `--save-model` writes)."""
    data = json.loads(fitted.model.to_json())
    if fitted.chain.runs:
        data["compensation"] = fitted.chain.numbers()
    return json.dumps(data, indent=2)


def load_model(path: str) -> GlintModel:
    """Read the model of a removal that `--save-model` wrote.

    Raises
    ------
    ReadError, InputError
        No such file, or not a saved model.
    """
    text = read_text(path, "--model")
    try:
        return GlintModel.from_json(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def load_chain(path: str) -> Chain:
    """Read the compensation that was saved with a model; one of no stages where there was none.

    Raises
    ------
    ReadError, InputError
        No such file, or not a saved compensation.
    """
    text = read_text(path, "--model")
    try:
        found = json.loads(text).get("compensation")
        if not found:
            return Chain()
        return chain_from(found)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise InputError(f"{path}: {error}") from error
