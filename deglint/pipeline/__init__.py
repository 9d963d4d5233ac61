"""From a file to a deglinted file: read an overview, fit on a sample, correct tile by tile, record what was done.

The only package that combines readers, masks, methods and writers. A `Recipe` holds the options, `fit_scene` fits them
to a scene, `remove_glint` processes a file. Names are imported at first use, so that commands that need only a part
start quickly.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .fit import Fitted, fit_scene
    from .flags import FLAGS, GLINT_CLASSES
    from .outputs import Outputs, Result, load_chain, load_model
    from .recipe import Recipe
    from .run import remove_glint

_HOMES = {
    "FLAGS": "flags", "GLINT_CLASSES": "flags", "Fitted": "fit", "Outputs": "outputs", "Recipe": "recipe",
    "Result": "outputs", "fit_scene": "fit", "load_chain": "outputs", "load_model": "outputs", "remove_glint": "run",
}  # fmt: skip
__all__ = [
    "FLAGS", "GLINT_CLASSES", "Fitted", "Outputs", "Recipe", "Result", "fit_scene", "load_chain", "load_model",
    "remove_glint",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a name from its module at first use."""
    from importlib import import_module

    if name in _HOMES:
        return getattr(import_module(f".{_HOMES[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
