"""Detection of ships, boats and swimmers on the sea: search region, detector and false-alarm rates.

`region` separates water, floating objects and land. `fit` and `score` compare every pixel of the sea with the
water around it. `Clutter` computes thresholds, and the expected number of false objects per km2. No file is opened.
"""

from .model import LEAST_WATER, SEA_WINDOW, SIDES, SeaModel, fit, score
from .region import AFLOAT, ALONGSIDE, ATTACHED, NOT_SEA, RIM, WATER, SeaRule, region
from .search import LOW, Clutter, clutter_of, score_scene

__all__ = [
    "AFLOAT", "ALONGSIDE", "ATTACHED", "LEAST_WATER", "LOW", "NOT_SEA", "RIM", "SEA_WINDOW", "SIDES", "WATER",
    "Clutter", "SeaModel", "SeaRule", "clutter_of", "fit", "region", "score", "score_scene",
]  # fmt: skip
