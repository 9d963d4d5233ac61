"""Detection of ships, boats and swimmers on the sea: search region, detector and false-alarm rates.

`region` finds the pixels of the sea, floating objects included. `fit` and `score` compare every pixel with the water
around it. `rates` computes thresholds, and the expected number of false objects per square kilometre. All functions
work on arrays; none opens a file.
"""

from .model import SEA_WINDOW, SIDES, SeaModel, fit, score
from .rates import Clutter, clutter_of
from .region import AFLOAT, ALONGSIDE, ATTACHED, NOT_SEA, RIM, WATER, SeaRule, region
from .search import Search, score_scene

__all__ = [
    "AFLOAT", "ALONGSIDE", "ATTACHED", "NOT_SEA", "RIM", "SEA_WINDOW", "SIDES", "WATER", "Clutter", "SeaModel",
    "SeaRule", "Search", "clutter_of", "fit", "region", "score", "score_scene",
]  # fmt: skip
