"""Joyce (2004): slope against the NIR, glint-free NIR at its mode.

Assumes that most pixels of the sample are free of glint, so that the mode of the NIR is that of water; this fails above
a fraction of glint pixels of about 60 %. The most robust of the three classic methods if there is little glint. The
mode is defined in `deglint.remove.levels.mode`. Costs one pass over the sample and one sort of its NIR values.
"""

from .levels import mode
from .model import GlintModel
from .request import FitRequest, check_sample, linear_model
from .statistics import SampleStatistics


def fit(request: FitRequest, stats: SampleStatistics) -> GlintModel:
    """L'_i = L_i - b_i (NIR - mode NIR).

    Joyce (2004), "A method for mapping live coral cover using remote sensing", PhD thesis, The University of
    Queensland; as given by Kay, Hedley, Lavender (2009), Remote Sensing 1, 697-730, doi:10.3390/rs1040697, section
    3.2.
    """
    check_sample(request, stats)
    levels = [mode(stats.index_values(k)) for k in range(len(request.indexes))]
    return linear_model("joyce", request, levels, stats)
