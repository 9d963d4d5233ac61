"""Where to look from, before flying: the glint avoidance tool.

    from deglint.plan import Mission, reticle

    plan = reticle(Mission(latitude=36.8, longitude=-122.0, time="2026-06-21T18:00Z", wind=7.0, wind_from=310.0))
    plan.combined  # contrast over noise from every viewing geometry, 0 where glint, sky or noise exclude it

For every viewing geometry of an object under water: how much of the sea mirrors the sun, how bright glint and sky are
against the water, and how the object contrasts with them.
"""

from .mission import Limits, Mission
from .reticle import Reticle, reticle

__all__ = ["Limits", "Mission", "Reticle", "reticle"]
