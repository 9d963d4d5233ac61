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

from .state import Float32Array

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
