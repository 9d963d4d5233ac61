"""Glint compensation: what removal pixel by pixel cannot do, because bands see the sea at different instants.

Five kinds of stages, one module each, to be put together in any order: `normalise` (median of deep water), `sharpen`
(PSF correction), `identify` (which pixels are glint), `replace` (by the water beside them, or by another band),
`median` (adaptive, as a last resort); `chain` puts them together. Arrays only: `fit` on a sample gives frozen
numbers, `apply` works on a block with a halo, and tiles give what the whole gives, to the bit.

Never here: files, tiles, threads, water masks, logging.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..scene import FloatArray
from .chain import STAGES, THESIS, Chain, Step, apply_stages, chain_from, finish, parse
from .fitting import Sample, Setting, fit_stages
from .psf import PSF, system_psf
from .state import State

__all__ = [
    "PSF", "STAGES", "THESIS", "Chain", "Sample", "Setting", "State", "Step", "apply", "apply_stages", "chain_from",
    "finish", "fit", "fit_stages", "parse", "system_psf",
]  # fmt: skip


def fit(
    text: str,
    block: FloatArray,
    setting: Setting,
    *,
    sample: npt.NDArray[np.bool_] | None = None,
    bands: Sequence[int] | None = None,
) -> Chain:
    """Fit the stages of a chain before its removal to an array in memory.

    Parameters
    ----------
    text : str
        The chain, such as ``identify-level:13, replace-level``; `THESIS` is one.
    block : (band, row, column) ndarray
        Physical values, NaN where not valid.
    setting : Setting
        The bands, their PSFs where known, and whether they see the sea at different instants.
    sample : (row, column) bool ndarray, optional
        True over deep water; every pixel by default.
    bands : sequence of int, optional
        Bands that `identify-level` looks at.

    Raises
    ------
    InputError
        A chain that cannot be, or an array of the wrong shape.
    FitError
        The sample is too small.

    Examples
    --------
    >>> import numpy as np
    >>> from deglint.scene import Band
    >>> sea = 1 + 0.01 * np.random.default_rng(1).standard_normal((1, 64, 64)).astype(np.float32)
    >>> sea[0, 30, 30] = 9
    >>> chain = fit("identify-level:5, replace-level", sea, Setting((Band("green"),)))
    >>> bool(apply(sea, chain)[0, 30, 30] < 1.1)
    True
    """
    if block.ndim != 3 or len(block) != len(setting.bands):
        raise InputError(f"expected an array of ({len(setting.bands)}, row, column), got shape {block.shape}.")
    inside = np.ones(block.shape[1:], np.bool_) if sample is None else np.asarray(sample, np.bool_)
    if inside.shape != block.shape[1:]:
        raise InputError(f"the sample must be of shape {block.shape[1:]} like the block, got {inside.shape}.")
    steps = parse(text)
    before = steps[: [s.name for s in steps].index("remove")]
    found = fit_stages(before, Sample([State.of(block)], [inside]), setting, bands=bands, cuts=None)
    return Chain(found, (), text)


def apply(block: FloatArray, chain: Chain, *, where: npt.NDArray[np.bool_] | None = None) -> FloatArray:
    """Apply the stages of a chain before its removal.

    Parameters
    ----------
    block : (band, row, column) ndarray
        Not modified. A tile needs `chain.halo_before` more pixels on every side.
    chain : Chain
    where : (row, column) bool ndarray, optional
        Pixels that may be changed.

    Returns
    -------
    (band, row, column) ndarray
        Like `block`; what is no glint is passed bit for bit.
    """
    return finish(apply_stages(State.of(block, where), chain.before), block)
