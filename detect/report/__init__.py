"""The report of `rxdetect roc`, which compares score rasters with true targets: numbers (JSON) and one HTML page."""

from .evaluate import Evaluation, Request, evaluate
from .page import page

__all__ = ["Evaluation", "Request", "evaluate", "page"]
