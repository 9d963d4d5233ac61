"""Separation of targets and background by scores: ROC curves, their summary numbers and confidence intervals.

A pixel is a target where truth is not 0, and is detected where its score is greater than a threshold: higher is more
anomalous. Pixels that are NaN or not valid are left out and counted. No file is opened here.
"""

from .bootstrap import bootstrap
from .curve import Roc, auc_interval, compare
from .per_object import false_alarms, number_objects, object_curve

__all__ = ["Roc", "auc_interval", "bootstrap", "compare", "false_alarms", "number_objects", "object_curve"]
