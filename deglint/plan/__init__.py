"""The glint avoidance tool: viewing geometries without sun glint, before flying.

    from deglint.plan import Mission, reticle

    plan = reticle(Mission(latitude=36.8, longitude=-122.0, time="2026-06-21T18:00Z", wind=7.0, wind_from=310.0))
    plan.combined  # contrast over noise from every viewing geometry, 0 where glint, sky or noise exclude it

For every viewing geometry of an object under water: the share of the sea that reflects the sun, the radiance of sun
glint and reflected sky relative to the water, and the contrast of the object.
"""

from .mission import Limits, Mission
from .reticle import Reticle, reticle

__all__ = ["Limits", "Mission", "Reticle", "reticle"]
