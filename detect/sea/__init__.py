"""Ships, boats and swimmers on the sea: the region to search, the detector, and the false-alarm rates that hold.

`region` says which pixels are sea, floating objects included; `fit` and `score` compare every pixel with the water
around it; `rates` turns scores into thresholds and into expected false objects per square kilometre. Arrays only.
"""

from .model import SEA_WINDOW, SIDES, SeaModel, fit, score
from .rates import Clutter, clutter_of
from .region import AFLOAT, ALONGSIDE, ATTACHED, NOT_SEA, RIM, WATER, SeaRule, region
from .search import Search, score_scene

__all__ = [
    "AFLOAT",
    "ALONGSIDE",
    "ATTACHED",
    "NOT_SEA",
    "RIM",
    "SEA_WINDOW",
    "SIDES",
    "WATER",
    "Clutter",
    "SeaModel",
    "SeaRule",
    "Search",
    "clutter_of",
    "fit",
    "region",
    "score",
    "score_scene",
]  # fmt: skip
