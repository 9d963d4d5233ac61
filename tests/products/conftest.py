"""Makers of small products for the tests of this folder."""

import importlib.util
from pathlib import Path

import pytest


def _module(name):
    spec = importlib.util.spec_from_file_location(f"products_{name}", Path(__file__).with_name(f"{name}.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def make():
    """Products of public missions."""
    return _module("makers")


@pytest.fixture(scope="session")
def cases():
    """The products that the tests of this folder open: (maker, kind, facts) by name, and the module with the makers."""
    makers, vendors = _module("makers"), _module("vendors")
    found = {k: (makers, *v) for k, v in _module("test_products").CASES.items()}
    return found | {k: (vendors, *v) for k, v in _module("test_vendors").CASES.items()}


@pytest.fixture(scope="session")
def vendor():
    """Products of commercial satellites and of drones."""
    return _module("vendors")
