"""From files to a `Scene`: open them, identify the bands, and find the near infrared.

Opening a scene reads headers, tags and names only. Later, `undeclared` reads a sample of the pixels if a file does not
declare nodata or offset. Conclusions are recorded in `Scene.notes`, one line each.
"""

from .opening import open_scene
from .roles import band_roles, explain_nir, find_nir

__all__ = ["band_roles", "explain_nir", "find_nir", "open_scene"]
