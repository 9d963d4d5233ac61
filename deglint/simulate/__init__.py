"""Synthetic scenes of the sea with the truth beside them: pure functions from a `Setup` to arrays.

`simulate(Setup(...))` gives a `SimulatedScene`; `deglint.raster.simulated` writes it. Rooms: `setup` (all
parameters), `light` (sun, sky and water in each band), `facets` (the moving sea), `objects` (what lies under
water), `scene` (puts it together), `experiments` (grids of setups). No files are touched here.
"""

from .objects import SubmergedObject, square, thesis_array
from .scene import SimulatedScene, simulate
from .setup import Setup

__all__ = ["Setup", "SimulatedScene", "SubmergedObject", "simulate", "square", "thesis_array"]
