"""Load what is compiled while something else is waited for: numba and its tables, and every kernel of compensation.

That takes as long as all of a fit's arithmetic, most of it in Python; reading a scene and working on whole arrays is
done meanwhile, on other threads.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np

from ..compensate import State
from ..compensate.chain import Sharpen
from ..compensate.codes import decoded, encoded
from ..compensate.evidence import BINS, Protection, clusters
from ..compensate.faint import give_back
from ..compensate.identify import IdentifyLevel
from ..compensate.noise import Spread
from ..compensate.presence import Presence, blend
from ..compensate.protect import put_back, things
from ..compensate.psf import kernel_psf
from ..compensate.replace import ReplaceLevel
from ..compensate.shapes import Shapes
from ..raster.encode import encode
from ..remove import BandFit, GlintIndex, GlintModel
from ..remove.model import apply_compiled

BANDS, SIDE = 3, 32
"""Of the block that the kernels are tried on; bands agree only where there are three."""
LAST = "deglint.remove._model_kernels"
"""Module of the kernels that are loaded last."""
UNLIKELY = -20.0
"""Log density of its sparkle, so that there is a thing in it."""


@contextmanager
def warming(wanted: bool) -> Iterator[None]:
    """Load it on a thread of its own, if it is not there yet, until it is done or no longer waited for."""
    if not wanted or LAST in sys.modules:
        yield
        return
    over = threading.Event()
    thread = threading.Thread(target=_tried, args=(over,), name="deglint-warming")
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _tried(over: threading.Event) -> None:
    """What goes wrong here goes wrong again, and is told, where a kernel is needed."""
    with suppress(Exception):
        for _ in warm_up():
            if over.is_set():
                return


def warm_up() -> Iterator[None]:
    """Load numba, and run what is compiled on a few pixels, piece by piece."""
    without_scipy()
    yield
    sea = np.ones((BANDS, SIDE, SIDE), np.float32)
    sea[:, 9:12, 9:12] = 2.0
    psf = kernel_psf([[0, 1, 0], [1, 4, 1], [0, 1, 0]])
    ones, every = (1.0,) * BANDS, tuple(range(BANDS))
    level = IdentifyLevel(5, 3, every, every, ((1.0, 0.1),) * BANDS, ones, ones, ones, ones, (np.inf,) * BANDS)
    stages = Sharpen((psf,) * BANDS, 1), level, ReplaceLevel()
    state = State.of(sea)
    Presence(0, 1.0, 0.1).cells(sea, 0, 0)
    decoded(encoded(sea[0], 1.0, 0.1), 1.0, 0.1)
    part, hit = sea[:, 1:9, 1:9].copy(), np.zeros(sea.shape, np.bool_)[:, 1:9, 1:9]
    share = np.zeros((8, 8), np.float32)
    give_back(sea[:, 1:9, 1:9], part, hit, share, [Spread(0, 1.0)], (slice(0, 8),) * 2, part)
    blend(part, sea[:, 1:9, 1:9], share)
    for stage in stages:
        stage.apply(state)
        yield
    flat, one = np.full((BANDS - 1, BINS, BINS), UNLIKELY), np.ones(1)
    grey = Shapes(np.ones((1, BANDS)), one, one, one, np.array([-1]), one)
    told = Protection(
        every, ones, ((1e-6, 0.0),) * BANDS, ones, (450.0, 550.0, 650.0), 25.0, 1.0,
        shapes=grey, first=flat[0, 0], following=flat,
    )  # fmt: skip
    clusters(np.zeros(sea.shape[1:]), 1.0)
    yield
    put_back(state.image, np.ones_like(sea), things(sea, np.ones_like(sea), told))
    yield
    encode(state.image, np.ones(sea.shape, np.uint16), bands=every, scales=ones, offsets=ones, compiled=True)
    fits = (BandFit(0, "", 0, 1.0, None, 1.0, 1),)
    apply_compiled(state.image, GlintModel("multiband", (GlintIndex((1, 2), (0.5, 0.5), 1.0),), fits, ("",) * BANDS))


def without_scipy() -> None:
    """Import numba without SciPy's linear algebra, which takes longer than the rest of it together.

    numba only looks whether it is there, which it is, and imports it again where a kernel multiplies matrices.
    """
    import numba.np.linalg as linalg

    with suppress(AttributeError, ImportError):
        look = linalg.ensure_blas
        linalg.ensure_blas = lambda: None
        try:
            import numba.np.arraymath as arraymath

            arraymath.ensure_blas = look
        finally:
            linalg.ensure_blas = look
