"""Examples in docstrings run."""

import doctest
import importlib
import pkgutil

import pytest

from deglint import physics

ROOMS = [name for _, name, _ in pkgutil.walk_packages(physics.__path__, "deglint.physics.")]


@pytest.mark.parametrize("room", ROOMS)
def test_examples_in_docstrings_run(room):
    assert doctest.testmod(importlib.import_module(room)).failed == 0
