"""Posterior mean of the water, given what removal leaves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .noise import noise, spread
from .state import Float32, Mask, Sample, Setting, State


def left_over(rests, glints, inside, s: float):
    """Variance of what removal left, by the glint that it took."""
    g = np.concatenate([a[m] for a, m in zip(glints, inside, strict=True)])
    e = np.concatenate([a[m] for a, m in zip(rests, inside, strict=True)])
    q = np.unique(np.quantile(g, [*np.linspace(0, .95, 20), .97, .985, .993, .998, 1]))
    if len(q) < 3:
        return np.zeros(1), np.zeros(1)
    i = np.searchsorted(q[1:-1], g)
    sd = np.maximum.accumulate([spread(e[i == j]) if (i == j).sum() > 30 else 0 for j in range(len(q) - 1)])
    return .5 * (q[1:] + q[:-1]), np.maximum(sd ** 2 - s * s, 0)


def posterior(x, v, s, r, bad=None, turns=3, k=4.):
    import cv2

    def mean(a):
        return cv2.GaussianBlur(a.astype("f4"), (0, 0), r)
    s2 = np.float32(s * s)
    V = v + s2
    if bad is not None:
        V = np.where(bad, 1e6 * s2 + V, V)
    w = first = s2 / V
    for i in range(turns):
        sw = mean(w) + 1e-9
        mu = mean(w * x) / sw
        t2 = np.maximum(mean(w * (x - mu) ** 2) / sw - mean(w * V) / sw, 0) + np.float32(.01) * s2
        far = (x - mu) ** 2 > k * k * (V + t2)
        if i < turns - 1:
            w = np.where(far, .01 * first, first)
    share = (V - s2) / (V + t2)
    return (x - (x - mu) * share).astype("f4"), V * t2 / (V + t2)
