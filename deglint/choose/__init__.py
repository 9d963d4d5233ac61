"""Choose a recipe for a scene: run a few candidates on sample tiles, and take the one with the least expected error.

Known signals are added to the tiles (`implants`). Every candidate is fitted and run with and without them, and its
expected error is computed from the texture and the signals in its result (`score`). No file is read here.
"""

from .candidates import Candidate, candidates
from .trial import Choice, Trial, choose, without_ships

__all__ = ["Candidate", "Choice", "Trial", "candidates", "choose", "without_ships"]
