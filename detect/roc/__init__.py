"""ROC curves, their summary numbers and confidence intervals: how well scores separate targets from background.

The truth is an array that is not 0 at the pixels of targets. A pixel is detected if its score is greater than a
threshold; a higher score is more anomalous. Pixels that are NaN or not valid are left out. No file is opened here.
"""

from .bootstrap import bootstrap
from .curve import Roc, auc_interval, compare
from .per_object import false_alarms, number_objects, object_curve

__all__ = ["Roc", "auc_interval", "bootstrap", "compare", "false_alarms", "number_objects", "object_curve"]
