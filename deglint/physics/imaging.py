"""Image formation: from a scene on a grid finer than the pixels to the pixels of the sensor.

The MTF is applied to the spectrum of the fine grid, which contains frequencies far above the Nyquist frequency of the
pixels; taking every n-th point then aliases as the sensor does. The scene is assumed to be periodic. Only blur is
modelled here: radiometry and noise are in `deglint.physics.sensor`.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ._checks import Floats
from .sensor import Sensor, cutoff
from .surface import by_rows

Complex = npt.NDArray[np.complexfloating[Any, Any]]


def transform(scene: Floats, *, workers: int = 1) -> Complex:
    """Half spectrum of a scene on the fine grid, for `observe`: (row, column // 2 + 1) complex."""
    from scipy import fft

    return fft.rfft2(scene, workers=workers)


def observe(
    spectrum: Complex,
    sensor: Sensor,
    wavelength: float,
    *,
    factor: int,
    shift: tuple[float, float] = (0.0, 0.0),
    workers: int = 1,
) -> Floats:
    """The image that the sensor takes of a scene on a finer grid, without noise.

    Raises InputError: the grid does not divide into pixels.

    Parameters
    ----------
    spectrum : (row, column // 2 + 1) complex ndarray
        Of the fine grid, from `transform`; rows and columns are even multiples of `factor`.
    sensor, wavelength : Sensor, float
        Sensor whose optics and detector blur, and the wavelength [nm].
    factor : int
        Fine points per pixel, each way. Frequencies above factor / 2 cycles per pixel are not in the scene.
    shift : (float, float)
        Misregistration of the band, down and right [pixel].
    workers : int
        Threads; the result does not depend on their number.

    Returns
    -------
    (row, column) ndarray
        Mean over each pixel, in the units of the scene; the mean of the scene is kept.

    Examples
    --------
    >>> from deglint.physics.presets import preset
    >>> flat = transform(np.full((64, 64), 3.0, dtype=np.float32))
    >>> bool(np.allclose(observe(flat, preset("thesis"), 545.0, factor=4), 3.0))
    True
    """
    from scipy import fft

    from ._imaging_kernels import fold

    fine_rows, fine_columns = spectrum.shape[0], 2 * (spectrum.shape[1] - 1)
    if fine_rows % factor or fine_columns % factor:
        raise InputError(f"grid must be a multiple of factor {factor}, got {fine_rows} x {fine_columns}; pad it")
    rows, columns = fine_rows // factor, fine_columns // factor
    centre = (factor - 1) / (2 * factor)
    row_frequency = np.fft.fftfreq(fine_rows, rows / fine_rows)
    column_frequency = np.arange(spectrum.shape[1]) / columns
    down = _along(row_frequency, sensor, centre + shift[0]) * np.sinc(sensor.smear * row_frequency)
    right = _along(column_frequency, sensor, centre + shift[1])
    folded = np.empty((rows, spectrum.shape[1]), dtype=spectrum.dtype)
    factors = (row_frequency, down), (column_frequency, right)
    limit = cutoff(sensor, wavelength)
    by_rows(lambda first, last: fold(spectrum, folded, first, last, *factors, limit), rows, workers)
    folded = fft.ifft(folded, axis=0, overwrite_x=True, workers=workers)
    return np.ascontiguousarray(fft.irfft(folded, n=fine_columns, axis=1, workers=workers)[:, ::factor])


def _along(frequency: Floats, sensor: Sensor, shift: float) -> Complex:
    """MTF of detector and jitter along one axis, and the phase of a shift of the sampling points by `shift` pixels."""
    blur = np.sinc(frequency) * np.exp(-2 * np.pi**2 * (sensor.jitter * frequency) ** 2)
    return np.asarray(blur * np.exp(2j * np.pi * frequency * shift))
