"""Reports on score rasters compared with truth: numbers (JSON) and one self-contained page (HTML)."""

from .evaluate import Evaluation, Request, evaluate
from .page import page

__all__ = ["Evaluation", "Request", "evaluate", "page"]
