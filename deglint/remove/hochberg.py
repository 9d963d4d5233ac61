"""Hochberg, Andrefouet and Tyler (2003): slope between the brightest and the darkest NIR pixel.

Assumes that these two pixels differ in glint alone. As published it rests on two pixels, so one boat in the sample
spoils it: draw the sample with care. Costs one pass over the sample.

References
----------
Hochberg, Andrefouet, Tyler (2003), "Sea surface correction of high spatial resolution Ikonos images to improve bottom
mapping in near-shore environments", IEEE Transactions on Geoscience and Remote Sensing 41, 1724-1729,
doi:10.1109/TGRS.2003.815408.
"""

from __future__ import annotations

from dataclasses import replace

from .model import GlintModel
from .request import FitRequest, check_sample, fixed_fits, r2_warning, regression_plan, sample_warnings
from .statistics import SamplePlan, SampleStatistics


def plan(request: FitRequest) -> SamplePlan:
    """What to gather: moments, and the brightest and darkest pixel of the first NIR reference."""
    single = replace(request, indexes=request.indexes[:1], regression="ols")
    return regression_plan(single, keep_index=False)


def fit(request: FitRequest, stats: SampleStatistics) -> GlintModel:
    """L'_i = L_i - f (L_i(brightest) - L_i(darkest)), f = (NIR - min NIR) / (max NIR - min NIR)."""
    single = replace(request, indexes=request.indexes[:1])
    check_sample(single, stats)
    dark, bright = stats.darkest[0], stats.brightest[0]
    slopes = (bright.spectrum - dark.spectrum) / (bright.value - dark.value)
    fits = fixed_fits(request, slopes, stats)
    warnings = sample_warnings(stats) + [w for fit in fits for w in r2_warning(fit)]
    index = replace(single.indexes[0], level=dark.value)
    return GlintModel("hochberg", (index,), fits, request.names, None, tuple(warnings))
