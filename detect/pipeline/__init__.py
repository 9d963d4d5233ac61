"""From a raster to scores: fit the background over tiles, score them, cut, mark objects, say what was done.

The only room of detect that puts readers, detectors and writers together. A `Recipe` says what to do, `score_file` does
the whole job.
"""

from .recipe import Outputs, Recipe
from .run import Result, score_file

__all__ = ["Outputs", "Recipe", "Result", "score_file"]
