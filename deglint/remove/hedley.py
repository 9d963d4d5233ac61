"""Hedley, Harborne and Mumby (2005): slope of each band on the NIR; the minimum NIR is taken as glint-free NIR.

The method assumes that the glint of every band is proportional to the glint of the NIR, that water is dark in the NIR,
and that some pixel of the sample is free of glint. It fails where bands are not simultaneous, and if the darkest pixel
is an outlier (a shadow, a dead detector): then use `floor_percentile`. It costs one pass over the sample.
"""

import numpy as np

from .model import GlintModel
from .request import FitRequest, check_sample, linear_model
from .statistics import SampleStatistics


def fit(request: FitRequest, stats: SampleStatistics) -> GlintModel:
    """Fit L'_i = L_i - b_i (NIR - m) with slopes b_i. m is the minimum NIR, or its `floor_percentile` if this is > 0.

    Hedley, Harborne, Mumby (2005), "Simple and robust removal of sun glint for mapping shallow-water benthos",
    International Journal of Remote Sensing 26, 2107-2112, doi:10.1080/01431160500034086.
    """
    check_sample(request, stats)
    levels = [darkest.value for darkest in stats.darkest]
    if request.floor_percentile > 0:  # in float64, since between float32 values numpy interpolates in float32
        kept = (stats.index_values(k).astype(np.float64) for k in range(len(levels)))
        levels = [float(np.percentile(values, request.floor_percentile)) for values in kept]
    return linear_model("hedley", request, levels, stats)
