"""Glint avoidance: before a flight, find the viewing geometries without sun glint.

    from deglint.plan import Mission, reticle
    plan = reticle(Mission(latitude=36.8, longitude=-122.0, time="2026-06-21T18:00Z", wind=7.0, wind_from=310.0))
    plan.combined  # contrast over noise by viewing geometry, 0 where glint, sky, noise or saturation exclude it

A viewing geometry is a zenith angle and an azimuth of the sensor, as seen from the sea above an object. For each,
a `Reticle` holds the share of the sea that reflects the sun into the sensor, the radiance of sun glint and of reflected
skylight, and the contrast between the object and deep water.
"""

from .mission import Limits, Mission
from .reticle import Reticle, reticle

__all__ = ["Limits", "Mission", "Reticle", "reticle"]
