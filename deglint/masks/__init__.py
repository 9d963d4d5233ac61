"""Which pixels are water, and which of the water makes a good sample to fit glint slopes.

Two questions, each answered in two steps: `fit_water` and `fit_sample` look at some blocks of the scene and
decide a few numbers; `water` and `deep_water` apply them to any block. A tile read with the rule's `halo` of
extra pixels around it gives, once cropped, exactly the mask of the whole scene. Outside the image there is
nothing: no value is made up for it.

Thresholds come from the scene, because its unit is not known (digital numbers, radiance, reflectance). This
room reads no files, keeps no state, and never changes a pixel.
"""

from .find import fit_water
from .sample import SampleRule, away_from_shore, deep_water, fit_sample, sample_halo
from .surface import Roles, WaterRule, water

__all__ = [
    "Roles", "SampleRule", "WaterRule", "away_from_shore", "deep_water", "fit_sample", "fit_water", "sample_halo",
    "water",
]  # fmt: skip
