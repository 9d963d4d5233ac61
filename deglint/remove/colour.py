"""The spectrum of glint, common to all bands: that of the sun in radiance, constant in reflectance. Arrays only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..moments import Float64
from .kernels import BandSet
from .request import FitRequest

COLOUR = 0.2
"""Relative uncertainty of the spectrum of glint: unknown aerosol changes blue relative to NIR by a fifth."""
SUN_ZENITH = 40.0
"""Sun zenith angle of the expected spectrum, which changes by less than `COLOUR` from 20 to 60 degrees [degree]."""


def shared_glint(
    response: Float64, covariance: Float64, request: FitRequest, sets: Sequence[BandSet]
) -> tuple[Float64, Float64]:
    r"""Weights of the bands in the glint common to them, and their responses drawn to its spectrum.

    Strength a of glint of known spectrum c by generalised least squares, then the posterior mean of each response.

    .. math:: a = \frac{c^T S^{-1} s}{c^T S^{-1} c}, \quad S = V + P, \quad P = \mathrm{diag}(0.2\, a c)^2, \quad
        s' = a c + P S^{-1} (s - a c)

    with s the responses of the bands and V their covariance. The spectrum with the smaller (s - a c)^T S^-1 (s - a c),
    of radiance or of reflectance, is used.
    """
    tiny = 1e-12 * max(float(np.trace(covariance)), np.finfo(float).tiny) * np.eye(len(response))
    if request.regression == "ols":
        weights = np.linalg.pinv(covariance + tiny) @ response
        return weights, response
    tried = []
    for colour in _colours(request, sets):
        size = float(np.median(response / colour))
        for _ in range(3):  # the prior is relative to the size, which converges at once
            prior = np.diag((COLOUR * size * colour) ** 2)
            weights = np.asarray(np.linalg.solve(covariance + prior + tiny, colour), np.float64)
            size = float(weights @ response / (weights @ colour))
        away = response - size * colour
        scaled = np.linalg.solve(covariance + prior + tiny, away)
        posterior = np.asarray(size * colour + prior @ scaled, np.float64)
        tried.append((float(away @ scaled), weights, posterior))
    return min(tried, key=lambda t: t[0])[1:]


def _colours(request: FitRequest, sets: Sequence[BandSet]) -> list[Float64]:
    """Glint in each band relative to its NIR: 1 (reflectance), and the sun's spectrum (radiance)."""
    from ..physics.atmosphere import irradiance

    grey = np.ones(len(request.correct))
    follows = {b: s.references[0] for s in sets for b in s.bands}
    pairs = [(request.bands[b].wavelength, request.bands[follows[i]].wavelength) for i, b in enumerate(request.correct)]
    if not all(w and 300 <= w <= 1000 for pair in pairs for w in pair):
        return [grey]
    own, nir = (irradiance(np.array(w, float), SUN_ZENITH).direct for w in zip(*pairs, strict=True))
    return [grey, own / nir]
