"""Masks: which pixels are water, and which water is a good sample for fitting glint slopes.

Each mask is made in two steps: `fit_water` and `fit_sample` determine a rule (a few numbers) from some blocks of the
scene; `water` and `deep_water` apply the rule to any block. If a tile is read with a margin of `rule.halo` pixels, and
its mask is cropped to the tile, the mask equals that of the whole scene. Pixels outside the image never are land.

Thresholds are determined from the scene, because its unit is not known (digital numbers, radiance, reflectance). The
functions read no files, keep no state, and never change a pixel.
"""

from .find import fit_water
from .sample import SHORE, SampleRule, deep_water, fit_sample
from .surface import Roles, WaterRule, water

__all__ = ["SHORE", "Roles", "SampleRule", "WaterRule", "deep_water", "fit_sample", "fit_water", "water"]
