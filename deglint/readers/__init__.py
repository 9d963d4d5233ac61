"""From files to a `Scene`: open them, identify the bands, and find the near infrared.

These modules read headers, tags and names, and pixels only where these do not say what a band is. Conclusions are
recorded in `Scene.notes`, one line each.
"""

from .opening import open_scene
from .roles import band_roles, explain_nir, find_nir

__all__ = ["band_roles", "explain_nir", "find_nir", "open_scene"]
