"""deglint: find and remove sun glint in multispectral images of the sea.

    import deglint

    deglint.remove_glint("scene.tif", "clean.tif")  # the whole job, by tiles

    scene = deglint.open_scene("scene.tif")  # or step by step
    fitted = deglint.fit_scene(scene, deglint.Recipe(method="hedley"))
    clean = deglint.correct(scene, fitted)

Names are loaded when they are first used: importing deglint itself costs next to nothing.
"""

from typing import Any

__version__ = "0.1.0"

_HOMES = {
    "open_scene": "readers",
    "find_nir": "readers",
    "Band": "scene",
    "Scene": "scene",
    "Recipe": "pipeline",
    "Result": "pipeline",
    "fit_scene": "pipeline",
    "remove_glint": "pipeline",
    "correct": "pipeline.apply",
    "METHODS": "remove",
    "GlintModel": "remove",
    "apply": "remove",
    "fit": "remove",
    "examine": "pipeline.examine",
    "DeglintError": "errors",
}

__all__ = ["__version__", *sorted(_HOMES)]


def __getattr__(name: str) -> Any:
    """Load a public name from the room it lives in."""
    if name not in _HOMES:
        raise AttributeError(f"module 'deglint' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f".{_HOMES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
