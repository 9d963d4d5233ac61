"""Joyce (2004): slope of each band on the NIR; the mode of the NIR is taken as glint-free NIR.

The method assumes that most pixels of the sample are free of glint, so that the mode of the NIR is the NIR of water. It
fails if more than about 60 % of the pixels have glint. If there is little glint, it is the most robust of the three
methods hedley, lyzenga and joyce. `levels.mode` defines the mode. A fit takes one pass and a sort of the sample's NIR.
"""

from .levels import mode
from .model import GlintModel
from .request import FitRequest, check_sample, linear_model
from .statistics import SampleStatistics


def fit(request: FitRequest, stats: SampleStatistics) -> GlintModel:
    """Fit L'_i = L_i - b_i (NIR - mode NIR), with L_i the values of band i, L'_i the result, b_i the slope on the NIR.

    Joyce (2004), "A method for mapping live coral cover using remote sensing", PhD thesis, University of Queensland; as
    given in section 3.2 of Kay, Hedley, Lavender (2009), Remote Sensing 1, 697-730, doi:10.3390/rs1040697.
    """
    check_sample(request, stats)
    levels = [mode(stats.index_values(k)) for k in range(len(request.indexes))]
    return linear_model("joyce", request, levels, stats)
