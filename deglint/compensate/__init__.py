"""Glint compensation: corrections in addition to a linear removal, for bands that differ in time, blur or noise.

A linear removal predicts the glint of each band from the NIR. A chain is a sequence of stages (`STAGES`) that process
the image before and after the removal. `fit_chain` fits a chain to a sample of a scene; `apply_chain` applies it to a
block of pixels with a halo. Both work on arrays: the caller reads files, finds water, makes the blocks and logs.
"""

from .background import Background
from .chain import FitRemoval, FittedChain, apply_chain, fit_chain, with_targets
from .posterior import Posterior, clump_width
from .psf import PSF, system_psf, typical_psf
from .replace_glint import ReplaceLevel
from .stages import STAGES, THESIS_CHAIN, Chain, parse
from .state import Sample, Setting, State
from .uncertainty import ReplacedError, fit_removed, fit_replaced, stderr

__all__ = [
    "PSF", "STAGES", "THESIS_CHAIN", "Background", "Chain", "FitRemoval", "FittedChain", "Posterior", "ReplaceLevel",
    "ReplacedError", "Sample", "Setting", "State", "apply_chain", "clump_width", "fit_chain", "fit_removed",
    "fit_replaced", "parse", "stderr", "system_psf", "typical_psf", "with_targets",
]  # fmt: skip
