"""From a file to a deglinted file: look, fit over the sample, apply over the tiles, say what was done.

The only room that puts readers, masks, methods and writers together. A `Recipe` says what to do, `fit_scene` fits it
to a scene, `remove_glint` does the whole job.
"""

from .apply import Outputs, Result, correct, remove_glint
from .correct import FLAGS
from .examine import examine
from .fit import Fitted, default_threads, fit_scene
from .recipe import Recipe
from .saved import load_chain, load_model

__all__ = [
    "FLAGS", "Fitted", "Outputs", "Recipe", "Result", "correct", "default_threads", "examine", "fit_scene",
    "load_chain", "load_model", "remove_glint",
]  # fmt: skip
