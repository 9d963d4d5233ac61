"""Background: what a band would be without glint, from the darkest pixels within a window (morphological opening)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from .noise import noise, spread
from .psf import PSF
from .sharpen import blurred
from .state import Float32, Mask, Sample, Setting, State

WINDOW = 13
MOST = 2.0
DENSE = 0.56
K = 0.5


def opening(band: Float32, size: int, cut: int = 0) -> Float32:
    """Opening with a square, its corners cut off by `cut` pixels; single minima do not count (median of 3 x 3)."""
    import cv2

    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    square = np.ones((max(size - 2 * cut, 1),) * 2, np.uint8)
    low = cv2.erode(band, square)
    if cut:
        low = cv2.erode(low, cross, iterations=cut)
    low = cv2.medianBlur(low, 3)
    if cut:
        low = cv2.dilate(low, cross, iterations=cut)
    return np.asarray(cv2.dilate(low, square), np.float32)


def outlines(sharp: Float32, level: Float32, size: int, order: tuple[int, ...], colour: Float32, rings: int = 1) -> Float32:
    """What windows of other shapes add to the background, as far as bands that are neighbours in time share it."""
    import cv2

    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    octagon, diamond = size - 2, size + 4
    detail = np.empty_like(sharp)
    for b, band in enumerate(sharp):
        d = np.maximum(opening(band, octagon, octagon // 4), opening(band, diamond, diamond // 2))
        for _ in range(rings):
            d = np.maximum(d, np.minimum(cv2.dilate(d, cross), cv2.medianBlur(band, 3)))
        detail[b] = np.maximum(d - level[b], 0) / colour[b]
    out = np.empty_like(detail)
    for place, b in enumerate(order):
        beside = [detail[order[i]] for i in (place - 1, place + 1) if 0 <= i < len(order)]
        out[b] = np.minimum(detail[b], np.float32(MOST) * np.max(beside, axis=0)) * colour[b]
    return out


def peak(excess: Float32) -> tuple[float, float]:
    """Where the commonest pixel lies above the background, and the spread of what lies below that."""
    away = np.abs(excess)
    d = excess[away > 1e-3 * np.median(away[away > 0])] if (away > 0).any() else excess
    low, high = np.percentile(d, [0.5, 70])
    counts, edges = np.histogram(d, 256, (low, max(high, low + 1e-12)))
    i = int(np.convolve(counts, np.ones(21) / 21, "same").argmax())
    c = 0.5 * (edges[i] + edges[i + 1])
    below = d[d < c] - c
    return float(c), float(spread(below) if below.size > 10 else d.std())


@dataclass(frozen=True)
class Background:
    name: ClassVar[str] = "identify-level"
    size: int
    order: tuple[int, ...]
    colour: tuple[float, ...]
    offsets: tuple[float, ...]
    sigmas: tuple[float, ...]
    cover: float
    detail: bool
    psfs: tuple[PSF, ...] | None

    @property
    def halo(self) -> int:
        return self.size + 4 + 2

    def level(self, state: State) -> Float32:
        sharp = state.image if state.sharp is None else state.sharp
        level = np.stack([opening(b, self.size) for b in sharp])
        if self.detail:
            level += outlines(sharp, level, self.size, self.order, np.array(self.colour, np.float32))
        if state.sharp is not None and self.psfs is not None:
            level = np.stack([blurred(b, p) for b, p in zip(level, self.psfs, strict=True)])
        return level

    def apply(self, state: State) -> State:
        level = self.level(state) + np.array(self.offsets, np.float32)[:, None, None]
        limit = (K * np.array(self.sigmas, np.float32))[:, None, None]
        return replace(state, background=level, glint=state.image - level > limit)


def fit(sample: Sample, setting: Setting, number: float | None = None) -> Background:
    size, middle = int(number or WINDOW), len(setting.bands) // 2
    sigma = [noise([s.raw[b] for s in sample.states], sample.inside) for b in range(len(setting.bands))]
    colour = setting.colour / np.median(setting.colour / np.array(sigma, np.float32))

    def tried(detail: bool, psfs: tuple[PSF, ...] | None) -> tuple[list[float], list[float], list[float]]:
        stage = Background(size, setting.order, tuple(map(float, colour)), (), (), 0.0, detail, psfs)
        levels = [stage.level(s) for s in sample.states]
        c, t, cover = [], [], []
        for b in range(len(setting.bands)):
            excess = sample.values([(s.raw[b] - m[b]) for s, m in zip(sample.states, levels, strict=True)])
            at, s = peak(excess)
            s = max(s, sigma[b])
            c.append(at), t.append(s), cover.append(float((excess > at + 3 * s).mean()))
        return c, t, cover
    cover = tried(False, None)[2][middle]
    detail = cover < DENSE and size >= 7
    c, t, cover = tried(detail, setting.psfs)
    return Background(size, setting.order, tuple(map(float, colour)), tuple(c), tuple(t), cover[middle], detail, setting.psfs)


def replace_glint(state: State) -> State:
    assert state.background is not None
    return replace(state, image=np.where(state.glint, state.background, state.image), replaced=state.glint)
