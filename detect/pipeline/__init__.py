"""Score a raster file: fit the background, score tile by tile, find the threshold, mark objects, write the sidecar.

Only this package combines readers, detectors and writers. A `Recipe` holds the options; `score_file` does all steps.
"""

from .recipe import Outputs, Recipe
from .run import Result, score_file

__all__ = ["Outputs", "Recipe", "Result", "score_file"]
