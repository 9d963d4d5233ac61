"""From files to a `Scene`: open it, learn its bands, and tell which of them is the near infrared.

These rooms read headers, tags and names, never pixels, and write nothing. What they deduce stands in
`Scene.notes`, one line each.
"""

from .opening import open_scene
from .roles import band_roles, explain_nir, find_nir

__all__ = ["band_roles", "explain_nir", "find_nir", "open_scene"]
