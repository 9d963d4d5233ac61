"""Brightness in sixteen bits: whole numbers in the order of the values, fine where noise is, never out of range.

``code = sign(q) [1024 log~(1 + |q|)], q = (x - centre) / unit``

where log~ is the logarithm to the base 2 with straight lines between powers of 2: the leading bits of 1 + |q| as a
floating-point number. With a unit of about the standard deviation of noise the steps are 1/1024 of it near the centre,
and 1/2048 to 1/1024 of q far from it, up to 4e9 deviations. Order is all that openings look at, and they return codes
that they were given.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..scene import Window
from .state import Float32Array, Mask

Codes = npt.NDArray[np.int16]
NOTHING = np.int16(32767)
"""Not valid; of a result, minus this."""


def encoded(band: Float32Array, centre: float, unit: float) -> Codes:
    """Codes of a band.

    Parameters
    ----------
    band : (row, column) float32 ndarray
        NaN is not valid. Rows may lie apart.
    centre, unit : float
        In the unit of the band; unit is positive.

    Examples
    --------
    >>> import numpy as np
    >>> encoded(np.array([[-1, 0, 1, 3, 1e9, np.nan]], np.float32), 0.0, 1.0).tolist()
    [[-1024, 0, 1024, 2048, 30579, 32767]]
    """
    from ._code_kernels import LANES, encode
    from .glance import block

    codes, (rows, columns) = np.empty(band.shape, np.int16), band.shape
    if columns < LANES or band.flags.c_contiguous:  # as one row
        columns = rows * columns
    if columns < LANES:
        some = encoded(np.resize(band, (1, LANES)), centre, unit) if band.size else codes
        return some.ravel()[: band.size].reshape(band.shape)
    if columns > band.shape[1]:
        band = np.ascontiguousarray(band).reshape(1, columns)
    numbers, _, per_row = block(np.asarray(band, np.float32)[None])
    encode(numbers, per_row, columns, np.float32(centre), np.float32(1.0 / unit), codes.ravel())
    return codes


def exceeding(
    codes: Codes, levels: Codes, within: Window, grid: tuple[float, float], limit: float, shown: Float32Array,
    share: float,
) -> Mask:  # fmt: skip
    """Where a part of a band exceeds its level.

    Parameters
    ----------
    codes : (row, column) int16 ndarray
        Of the band.
    levels : (row, column) int16 ndarray
        Of the level in that part.
    within : ((row0, row1), (col0, col1))
        Where the part lies in the band.
    grid : (float, float)
        Centre and unit of both.
    limit : float
        By more than this,
    shown : (row, column) float32 ndarray
        and a share of this, in that part.
    share : float

    Examples
    --------
    >>> import numpy as np
    >>> band = encoded(np.arange(40, dtype=np.float32).reshape(2, 20), 0.0, 1.0)
    >>> shown = np.zeros((1, 18), np.float32)
    >>> shown[0, 10] = 4
    >>> above = exceeding(band, np.zeros((1, 18), np.int16), ((1, 2), (2, 20)), (0.0, 1.0), 30.5, shown, 0.5)
    >>> above[0, 7:12].tolist()
    [False, False, True, False, True]
    """
    from ._code_kernels import LANES, exceed

    (top, _), (left, _) = within
    if levels.size == 0 or levels.shape[1] < LANES:
        above = decoded(codes[slice(*within[0]), slice(*within[1])], *grid) - decoded(levels, *grid)
        return np.asarray(above + shown * np.float32(-share) > np.float32(limit))
    out, per_row = np.empty(levels.shape, np.bool_), codes.shape[1]
    exceed(
        codes.ravel(), top * per_row + left, per_row, levels.ravel(), levels.shape[1], np.array(grid, np.float32),
        np.float32(limit), shown.ravel(), np.float32(share), out.ravel(),
    )  # fmt: skip
    return out


def decoded(codes: Codes, centre: float, unit: float) -> Float32Array:
    """The values of codes.

    Examples
    --------
    >>> import numpy as np
    >>> codes = encoded(np.array([[5.0, 5.5, 7.0, 30.0]], np.float32), 5.0, 0.5)
    >>> decoded(codes, 5.0, 0.5).tolist()
    [[5.0, 5.5, 7.0, 30.0]]
    """
    from ._code_kernels import LANES, decode

    values = np.empty(codes.shape, np.float32)
    if codes.size < LANES:
        some = decoded(np.resize(codes, LANES), centre, unit) if codes.size else values
        return some.ravel()[: codes.size].reshape(codes.shape)
    decode(np.ascontiguousarray(codes).ravel(), np.float32(centre), np.float32(unit), values.ravel())
    return values
