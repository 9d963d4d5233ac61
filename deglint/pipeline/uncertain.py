"""Learn a scene's standard errors: some of its tiles are corrected once more, and looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .. import tiles as tiling
from ..compensate.identify import IdentifyLevel
from ..compensate.uncertainty import fit
from ..errors import FitError, InputError
from ..raster.environment import enter_thread
from ..readers.roles import find_nir
from ..tiles import Tile
from .correct import Correction

VALUES = 8 << 20
"""Most values (pixels times bands) that are looked at."""


def with_stderr(work: Correction, everything: Sequence[Tile], nir: Sequence[str], threads: int) -> Correction:
    """The same correction, which tells standard errors as well.

    Parameters
    ----------
    work : Correction
    everything : sequence of Tile
        All tiles of the run.
    nir : sequence of str
        NIR bands that were named; found where empty.
    threads : int

    Raises
    ------
    FitError, InputError
        Too few clean pixels, or a compensation that has no level.
    """
    work = replace(work, want_stderr=True)
    levels = [s for s in work.chain.before if isinstance(s, IdentifyLevel)]
    if work.chain.before and (not levels or not any(s.name == "replace-level" for s in work.chain.before)):
        raise InputError("--stderr needs a compensation with replace-level before the removal, or --compensate off.")
    bands = tuple(work.changed)
    chosen = tiling.spread(everything, VALUES // len(work.scene.bands))
    parts = [done.parts for _t, done in tiling.run(chosen, work, threads=threads, start=enter_thread)]
    looks = [p for p in parts if p is not None and p.where.any()]
    if not looks:
        raise FitError("no pixel is corrected in the tiles that were looked at, so --stderr has nothing to learn from.")
    if not levels:
        return replace(work, uncertainty=fit(looks, work.model, bands))
    stage = levels[-1]
    if set(bands) - set(stage.bands):
        raise InputError("--stderr needs a level of every band: leave it out, or identify glint in all bands.")
    reference = find_nir(work.scene, list(nir) or None)[0]
    glint = dict(zip(stage.bands, stage.spectrum, strict=True))
    cover = stage.cover[stage.bands.index(reference)] if reference in stage.bands else float(np.median(stage.cover))
    return replace(work, uncertainty=fit(looks, work.model, bands, reference=reference, glint=glint, cover=cover))
