"""Glint avoidance: find, before flying, the viewing geometries without sun glint.

    from deglint.plan import Mission, reticle

    plan = reticle(Mission(latitude=36.8, longitude=-122.0, time="2026-06-21T18:00Z", wind=7.0, wind_from=310.0))
    plan.combined  # contrast over noise from every viewing geometry, 0 where glint, sky or noise exclude it

A `Reticle` holds, for every viewing geometry of an object under water, the share of the sea that reflects the sun, the
radiance of sun glint and of reflected skylight, and the contrast of the object.
"""

from .mission import Limits, Mission
from .reticle import Reticle, reticle

__all__ = ["Limits", "Mission", "Reticle", "reticle"]
