"""A plain chain of sharpening, opening, removal and opening, to measure beside: nothing in it knows of small things."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from deglint.physics.sensor import Sensor, psf

Array = npt.NDArray[np.float64]

SIZE = 11
"""Of the opening [pixel]; two less the second time."""
ANCHOR = 5.0
"""Percentile of the predicted glint that counts as none."""


def noise_model(sensor: Sensor) -> Array:
    """Variance of digital numbers at 0, and its increase per digital number, (band, 2)."""
    gain = sensor.well / sensor.levels
    return np.array([[(sensor.read_noise / gain) ** 2 + 1 / 12, 1 / gain]] * len(sensor.bands))


def opened(image: Array, size: int) -> Array:
    """Erosion, median of 3 x 3, dilation."""
    square = np.ones((size, size), np.uint8)
    low = cv2.medianBlur(cv2.erode(image.astype(np.float32), square, borderType=cv2.BORDER_REPLICATE), 3)
    return cv2.dilate(low, square, borderType=cv2.BORDER_REPLICATE).astype(np.float64)


def sharpened(image: Array, kernel: Array, iterations: int = 2) -> Array:
    """Richardson-Lucy."""
    y, k = np.maximum(image, 1e-3).astype(np.float32), kernel.astype(np.float32)
    out, mirrored = y.copy(), np.ascontiguousarray(k[::-1, ::-1])
    for _ in range(iterations):
        seen = np.maximum(cv2.filter2D(out, -1, k, borderType=cv2.BORDER_REFLECT), 1e-6)
        out *= cv2.filter2D(np.maximum(y / seen, 1e-3), -1, mirrored, borderType=cv2.BORDER_REFLECT)
    return out.astype(np.float64)


def replaced(band: Array, level: Array, noise: Array) -> tuple[Array, Array]:
    """The band with what exceeds the level by 3 standard deviations put down to it, and the level as calibrated."""
    away = (band - level)[np.abs(band - level) > 1e-6]
    counts, edges = np.histogram(away, 200, (np.percentile(away, 0.5), np.percentile(away, 80)))
    peak = int(np.convolve(counts, np.hanning(9), "same").argmax())
    usual = (edges[peak] + edges[peak + 1]) / 2
    spread = 1.4826 * np.median(usual - away[away <= usual])
    level = level + usual
    spread = max(float(spread), float(np.sqrt(noise[0] + noise[1] * max(np.median(level), 0.0))))
    return np.where(band > level + 3 * spread, level, band), level


def chain(image: Array, sensor: Sensor, visible: int, deep: slice) -> tuple[Array, Array]:
    """Compensated image and the level of each band, (band, row, column), in digital numbers."""
    noise, out, levels = noise_model(sensor), np.empty_like(image), np.empty_like(image)
    for b, band in enumerate(sensor.bands):
        level = opened(sharpened(image[b], psf(sensor, band.wavelength, size=17)), SIZE)
        out[b], levels[b] = replaced(image[b], level, noise[b])
    removed = out.copy()
    for b in range(visible):
        references = [r for r in range(visible - 1, len(out)) if r > b]
        x = out[references][:, :, deep].reshape(len(references), -1)[:, ::5]
        x = x - x.mean(axis=1, keepdims=True)
        y = out[b][:, deep].ravel()[::5]
        square = x @ x.T
        square += 1e-4 * np.trace(square) / len(references) * np.eye(len(references))
        predicted = np.tensordot(np.linalg.solve(square, x @ (y - y.mean())), out[references], 1)
        removed[b] -= predicted - np.percentile(predicted[:, deep], ANCHOR)
    for b in range(len(out)):
        removed[b] = replaced(removed[b], opened(removed[b], SIZE - 2), noise[b])[0]
    return removed, levels
