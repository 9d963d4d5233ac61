"""Choose a recipe for a scene: a few candidates run on sample tiles, and the least expected error wins.

Known signals are added to the tiles (`implants`). Every candidate is fitted and run with and without them, and its
expected error is computed from the texture and the signals in its result (`score`). Files are not read here.
"""

from .candidates import Candidate, candidates
from .trial import Choice, Trial, choose, without_ships

__all__ = ["Candidate", "Choice", "Trial", "candidates", "choose", "without_ships"]
