"""Processing of a scene from file to file: read an overview, fit to a sample, correct tiles, and record what was done.

This is the only package that combines readers, masks, methods and writers. A `Recipe` holds the options, `fit_scene`
fits a removal to a scene, and `remove_glint` processes a file.
"""

from .fit import Fitted, fit_scene
from .flags import FLAGS, GLINT_CLASSES
from .outputs import Outputs, Result, load_chain, load_model
from .recipe import Recipe
from .run import remove_glint

__all__ = [
    "FLAGS", "GLINT_CLASSES", "Fitted", "Outputs", "Recipe", "Result", "fit_scene", "load_chain", "load_model",
    "remove_glint",
]  # fmt: skip
