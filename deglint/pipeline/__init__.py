"""From a file to a deglinted file: look, fit over the sample, apply over the tiles, say what was done.

The only room that puts readers, masks, methods and writers together. A `Recipe` says what to do, `fit_scene` fits it
to a scene, `remove_glint` does the whole job. Names are loaded when they are first used: who only looks at a scene, or
only passes over its tiles, does not wait for the rest.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .fit import Fitted, fit_scene
    from .flags import FLAGS, GLINT_CLASSES
    from .outputs import Outputs, Result
    from .recipe import Recipe
    from .run import remove_glint
    from .sidecar import load_chain, load_model

_HOMES = {
    "FLAGS": "flags", "GLINT_CLASSES": "flags", "Fitted": "fit", "Outputs": "outputs", "Recipe": "recipe",
    "Result": "outputs", "fit_scene": "fit", "load_chain": "sidecar", "load_model": "sidecar", "remove_glint": "run",
}  # fmt: skip
__all__ = [
    "FLAGS", "GLINT_CLASSES", "Fitted", "Outputs", "Recipe", "Result", "fit_scene", "load_chain", "load_model",
    "remove_glint",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Load a name from the module it lives in."""
    from importlib import import_module

    if name in _HOMES:
        return getattr(import_module(f".{_HOMES[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
