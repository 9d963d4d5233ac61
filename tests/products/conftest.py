"""Makers of small products for the tests of this folder."""

import pytest

from . import makers, vendors


@pytest.fixture(scope="session")
def make():
    """Products of public missions."""
    return makers


@pytest.fixture(scope="session")
def cases():
    """The products that the tests of this folder open: (maker, kind, facts) by name, and the module with the makers."""
    from . import test_products, test_vendors

    found = {k: (makers, *v) for k, v in test_products.CASES.items()}
    return found | {k: (vendors, *v) for k, v in test_vendors.CASES.items()}


@pytest.fixture(scope="session")
def vendor():
    """Products of commercial satellites and of drones."""
    return vendors
