"""Compute anomaly scores of a raster file, tile by tile; then a threshold, and the objects above it.

`score_file` does all steps with the options of a `Recipe`. Only this package combines readers, detectors and writers.
"""

from .recipe import Outputs, Recipe
from .run import Result, score_file

__all__ = ["Outputs", "Recipe", "Result", "score_file"]
