"""deglint: find and remove sun glint in multispectral images of the sea.

    import deglint

    deglint.remove_glint("scene.tif", "clean.tif")  # file to file, tile by tile

    scene = deglint.open_scene("scene.tif")  # or step by step
    fitted = deglint.fit_scene(scene, deglint.Recipe(method="hedley"))
    clean = deglint.correct(scene, fitted)

Band numbers start at 1 where a user writes them (`Recipe`, `open_scene`, `find_nir`, the command line), and at 0 where
they index an array (`fit`, `apply`, `Scene.read`, the value that `find_nir` returns).

Decisions are logged to the logger "deglint" and its children (`logging`); nothing is printed. Names are imported at
first use, so that `import deglint` is fast.
"""

import logging
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .errors import DeglintError as DeglintError
    from .info import examine as examine
    from .pipeline.fit import Fitted as Fitted
    from .pipeline.fit import fit_scene as fit_scene
    from .pipeline.outputs import Result as Result
    from .pipeline.recipe import Recipe as Recipe
    from .pipeline.run import correct as correct
    from .pipeline.run import remove_glint as remove_glint
    from .readers.opening import open_scene as open_scene
    from .readers.roles import find_nir as find_nir
    from .remove import METHODS as METHODS
    from .remove import GlintModel as GlintModel
    from .remove import apply as apply
    from .remove import fit as fit
    from .scene import Band as Band
    from .scene import Scene as Scene

__version__ = "0.2.0"

_HOMES = {
    "METHODS": "remove",
    "Band": "scene",
    "DeglintError": "errors",
    "Fitted": "pipeline.fit",
    "GlintModel": "remove",
    "Recipe": "pipeline.recipe",
    "Result": "pipeline.outputs",
    "Scene": "scene",
    "apply": "remove",
    "correct": "pipeline.run",
    "examine": "info",
    "find_nir": "readers.roles",
    "fit": "remove",
    "fit_scene": "pipeline.fit",
    "open_scene": "readers.opening",
    "remove_glint": "pipeline.run",
}
"""Module of each public name. Type checkers read the imports above; a test checks that both lists are equal."""

__all__ = ["__version__", *_HOMES]

logging.getLogger(__name__).addHandler(logging.NullHandler())

if not TYPE_CHECKING:  # a type checker that sees this function accepts any name

    def __getattr__(name: str) -> object:
        """Import a public name of the package from its module, at the first use of the name."""
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import import_module

        return getattr(import_module(f".{_HOMES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
