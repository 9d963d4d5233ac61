"""Reports on files: scores judged against truth, as numbers (JSON) and as a page (HTML) that stands by itself."""

from .evaluate import Evaluation, Request, evaluate
from .page import page

__all__ = ["Evaluation", "Request", "evaluate", "page"]
