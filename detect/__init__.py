"""detect: find what does not belong in an image, and say how well it was found.

Names are loaded when they are first used: importing detect itself costs next to nothing.
"""

from typing import Any

from deglint import __version__

_HOMES: dict[str, str] = {
    "Background": "background",
    "Object": "objects",
    "Roc": "roc.curve",
    "Tail": "threshold",
    "Threshold": "threshold",
    "local_rx": "local",
    "residual_rx": "rx",
    "rx_utd": "rx",
    "subspace_rx": "rx",
    "utd": "rx",
}

__all__ = ["__version__", *sorted(_HOMES)]


def __getattr__(name: str) -> Any:
    """Load a public name from the room it lives in."""
    if name not in _HOMES:
        raise AttributeError(f"module 'detect' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f".{_HOMES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
