"""Expected spectrum of sun glint relative to the NIR, toward which the fitted slopes of bands are shifted."""

from typing import NamedTuple

import numpy as np

from ..moments import Float64, Mask
from .request import FitRequest

VISIBLE = 700.0  # wavelength up to which bands are visible [nm]
COLOUR = 0.2  # relative uncertainty of the spectrum of glint: unknown aerosol changes blue relative to NIR by a fifth
ROUNDING = 1e-6  # a slope below this share of the largest is rounding: the band shows no glint
SUN_ZENITH = 40.0  # for the spectrum of glint [degree]; the spectrum changes by less than `COLOUR` from 20 to 60


class CommonGlint(NamedTuple):
    """Estimate of the glint that is common to the bands, as `shared_glint` makes it."""

    weights: Float64  # (band,), which estimate the strength of glint from the bands
    response: Float64  # (band,): new responses of the bands
    covariance: Float64  # (band, band): of the responses that were fitted
    of_glint: Float64  # (band,): slopes of glint alone, as `slopes_of_glint` returns them

    @property
    def hidden(self) -> Float64:
        """Slopes of glint minus new responses, (band,); 0 where this is negative or the slope is NaN."""
        return np.fmax(self.of_glint - self.response, 0)


def shared_glint(response: Float64, covariance: Float64, explained: Float64, request: FitRequest) -> CommonGlint:
    r"""Weights that estimate the strength of glint from the bands, and new responses of the bands.

    The response of a band is its glint divided by the glint of its NIR (see `kernels`). The strength a of glint with
    the spectrum c is estimated by generalised least squares from the fitted responses s (`response`). The new responses
    s' are the posterior means, between s and a c.

    .. math:: a = \frac{c^T S^{-1} s}{c^T S^{-1} c}, \quad S = V + P, \quad P = \mathrm{diag}(0.2\, a c)^2, \quad
        s' = a c + P S^{-1} (s - a c)

    V (band, band) is the covariance of s. The weights are S^-1 c. As P depends on a, both are iterated. Spectrum c is
    that of glint in images of radiance or of reflectance, whichever has the smaller (s - a c)^T S^-1 (s - a c). With
    regression "ols", s' is s, and the weights are V^-1 s. `explained` is as in `slopes_of_glint`.
    """
    tiny = 1e-12 * max(float(np.trace(covariance)), np.finfo(float).tiny) * np.eye(len(response))
    if request.regression == "ols":
        of_glint = np.where(_visible(request), response, np.nan)
        return CommonGlint(np.linalg.pinv(covariance + tiny) @ response, response, covariance, of_glint)
    tried = []
    for colour in spectra(request):
        size = float(np.median(response / colour))
        for _ in range(3):  # the prior depends on the strength, which converges at once
            prior = np.diag((COLOUR * size * colour) ** 2)
            weights = np.asarray(np.linalg.solve(covariance + prior + tiny, colour), np.float64)
            size = float(weights @ response / (weights @ colour))
        away = response - size * colour
        scaled = np.linalg.solve(covariance + prior + tiny, away)
        tried.append((float(away @ scaled), weights, np.asarray(size * colour + prior @ scaled, np.float64)))
    _misfit, weights, posterior = min(tried, key=lambda t: t[0])
    return CommonGlint(weights, posterior, covariance, slopes_of_glint(posterior, explained, request))


def slopes_of_glint(slopes: Float64, explained: Float64, request: FitRequest) -> Float64:
    """Slopes that glint alone has, (band,), in visible bands; NaN in other bands, and where a slope is not positive.

    A band keeps its slope in `slopes` (band,) except in two cases. If no slope is more than `COLOUR` below the spectrum
    of glint, each lower slope is raised to the spectrum: noise or delays hide glint. A slope more than `COLOUR` above
    the spectrum is due to foam, darker in the NIR than glint, and is lowered to it. The spectrum is that of radiance or
    reflectance, whichever is nearer to `slopes`. The new slope is at most the old one divided by `explained`, (band,),
    the share of the variance of the band that its prediction explains; if that is not positive, there is no such limit.
    """
    out = np.full(len(slopes), np.nan)
    used = _visible(request) & (slopes > ROUNDING * np.max(slopes))
    if used.any():
        fitted = slopes[used]
        spectrum = min((c[used] for c in spectra(request)), key=lambda c: abs(np.log(np.median(fitted / c))))
        steep = fitted / spectrum
        alike = (steep > 1 - COLOUR).all()  # else not only noise and delays lessen the slopes
        limit = fitted / np.maximum(explained[used], np.finfo(np.float64).tiny)
        wrong = (steep > 1 + COLOUR) | ((steep < 1) & alike)
        out[used] = np.where(wrong, np.minimum(spectrum, limit), fitted)
    return out


def _visible(request: FitRequest) -> Mask:
    """Mask of the bands to correct, (band,), that are visible."""
    return np.array([(request.bands[b].wavelength or np.inf) < VISIBLE for b in request.correct], np.bool_)


def spectra(request: FitRequest) -> list[Float64]:
    """Possible spectra of glint divided by the glint in the NIR, (band,) each: 1 in all bands (images of reflectance);
    also that of sunlight (images of radiance) if the wavelengths of all bands and of their NIR are 300 to 1000 nm.
    """
    from ..physics.atmosphere import irradiance

    grey = np.ones(len(request.correct))
    bands, both = request.bands, zip(request.correct, request.nir, strict=True)
    pairs = [(bands[b].wavelength, bands[nir].wavelength) for b, nir in both]
    if not all(w and 300 <= w <= 1000 for pair in pairs for w in pair):
        return [grey]
    own, nir = (irradiance(np.array(w, float), SUN_ZENITH).direct for w in zip(*pairs, strict=True))
    return [grey, own / nir]
