"""Choose a recipe for a scene: a few candidates run on sample tiles, and the least expected error wins.

Known signals are added to the tiles (`implants`), every candidate is fitted and run with and without them, and its
expected error follows from what it leaves of the texture and of the signals (`score`). Arrays only.
"""

from .candidates import Candidate, candidates
from .trial import Choice, Trial, choose, without_ships

__all__ = ["Candidate", "Choice", "Trial", "candidates", "choose", "without_ships"]
