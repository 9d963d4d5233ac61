"""Glint compensation: what a linear removal cannot do, as bands are not simultaneous, or differ in blur and noise.

Stages, one module each, in any order around the removal (`STAGES`); `fit_chain` fits a chain to a sample, `apply_chain`
applies it to a block with a halo. Arrays only.

Never here: files, tiles, threads, water masks, logging.
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
