"""Synthetic scenes of the sea with their ground truth, computed from a `Setup` (the parameters of a scene).

`simulate(Setup(...))` returns a `SimulatedScene`; `simulate_together` returns one for each of several sensors that see
the same sea. `deglint.raster.simulated` writes them to files.
"""

from .artefacts import Artefacts
from .cover import whitecaps
from .scene import SimulatedScene, simulate, simulate_together
from .setup import FloatingTarget, Setup
from .underwater import Bottom, SubmergedObject, square, thesis_array

__all__ = [
    "Artefacts", "Bottom", "FloatingTarget", "Setup", "SimulatedScene", "SubmergedObject", "simulate",
    "simulate_together", "square", "thesis_array", "whitecaps",
]  # fmt: skip
