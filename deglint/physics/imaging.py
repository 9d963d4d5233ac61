"""Image formation: from a scene on a grid finer than the pixels (the fine grid) to the pixels of the sensor.

The spectrum of the fine grid has frequencies far above the Nyquist frequency of the pixels. It is multiplied by the
modulation transfer function (MTF), then sampled at the pixels, which causes aliasing as in the sensor. The scene is
assumed to be periodic. Only blur is modelled here: radiometry and noise are in `deglint.physics.sensor`.
"""

import numpy as np

from ..errors import InputError
from ._checks import Floats
from .sensor import Sensor, cutoff
from .surface import Complex, on_rows


def transform(scene: Floats, *, workers: int = 1) -> Complex:
    """Spectrum of a scene (row, column) by a real FFT on `workers` threads: complex array (row, column // 2 + 1)."""
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
    """Compute the noise-free image that the sensor takes of a scene on a grid finer than the pixels (the fine grid).

    The image is (row, column), in the unit of the scene; the mean of its pixels is the mean of the scene.
    Raises InputError if the number of rows or columns of the fine grid is not a multiple of `factor`.

    Parameters
    ----------
    spectrum : (row, column // 2 + 1) complex ndarray
        Spectrum from `transform` of a scene on the fine grid. The numbers of rows and of columns of this grid are
        multiples of `factor`, and the number of columns is even.
    sensor, wavelength : Sensor, float
        Sensor whose optics and detector blur the image, and the wavelength [nm].
    factor : int
        Points of the fine grid per pixel, along each axis: the scene has frequencies up to factor / 2 cycles per pixel.
    shift : (float, float)
        Misregistration of the band: displacement of its pixels relative to the scene, down and right [pixel].
    workers : int
        Number of threads; the result does not depend on it.

    Examples
    --------
    >>> from deglint.physics.presets import preset
    >>> flat = transform(np.full((64, 64), 3.0, dtype=np.float32))
    >>> bool(np.allclose(observe(flat, preset("thesis"), 545.0, factor=4), 3.0))
    True
    """
    from scipy import fft

    from ._kernels import fold

    fine_rows, fine_columns = spectrum.shape[0], 2 * (spectrum.shape[1] - 1)
    if fine_rows % factor or fine_columns % factor:
        raise InputError(f"grid must be a multiple of factor {factor}, got {fine_rows} x {fine_columns}; pad it")
    rows, columns = fine_rows // factor, fine_columns // factor
    centre = (factor - 1) / (2 * factor)
    row_frequency = np.fft.fftfreq(fine_rows, rows / fine_rows)
    column_frequency = np.arange(spectrum.shape[1]) / columns
    down = _along(row_frequency, sensor, centre + shift[0]) * np.sinc(sensor.smear * row_frequency)
    folded = np.zeros((rows, spectrum.shape[1]), dtype=spectrum.dtype)
    factors = (row_frequency, down), (column_frequency, _along(column_frequency, sensor, centre + shift[1]))
    limit = cutoff(sensor, wavelength)
    on_rows(lambda first, last: fold(spectrum, folded, first, last, *factors, limit), rows, workers)
    folded = fft.ifft(folded, axis=0, overwrite_x=True, workers=workers)
    return np.ascontiguousarray(fft.irfft(folded, n=fine_columns, axis=1, workers=workers)[:, ::factor])


def _along(frequency: Floats, sensor: Sensor, shift: float) -> Complex:
    """MTF of detector and jitter along an axis at frequencies [cycles/pixel], with the phase of a shift [pixel]."""
    blur = np.sinc(frequency) * np.exp(-2 * np.pi**2 * (sensor.jitter * frequency) ** 2)
    return np.asarray(blur * np.exp(2j * np.pi * frequency * shift))
