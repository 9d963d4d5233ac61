"""Masks: which pixels are water, and which water is a good sample for fitting glint slopes.

Each mask is made in two steps: `fit_water` and `fit_sample` determine a rule (a few numbers) from some blocks of the
scene; `water` and `deep_water` apply the rule to any block. A tile that is read with `rule.halo` more pixels on every
side, and then cropped, has exactly the mask of the whole scene. Nothing is extrapolated beyond the edge of the image.

Thresholds come from the scene, because its unit is not known (digital numbers, radiance, reflectance). This package
reads no files, keeps no state, and never changes a pixel.
"""

from .find import fit_water
from .sample import SampleRule, away_from_shore, deep_water, fit_sample, sample_halo
from .surface import Roles, WaterRule, water

__all__ = [
    "Roles", "SampleRule", "WaterRule", "away_from_shore", "deep_water", "fit_sample", "fit_water", "sample_halo",
    "water",
]  # fmt: skip
