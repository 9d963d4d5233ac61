"""Open image files as a `Scene`, identify its bands, and find its near-infrared band.

Opening a scene reads headers, tags and names only. Later, the module `undeclared` reads a sample of the pixels if a
file does not declare its nodata value, offset or NIR band. What is assumed is recorded in `Scene.notes`, one line each.
"""

from .opening import open_scene
from .roles import band_roles, explain_nir, find_nir

__all__ = ["band_roles", "explain_nir", "find_nir", "open_scene"]
