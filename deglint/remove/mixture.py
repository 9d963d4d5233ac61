r"""Mixture: removal of the weak glint that is left after strong glint was replaced.

.. math:: L'_b = L_b - (p_b - p_{b0}), \qquad p_b(x) = \sum_r \sum_o k_{bro} L_r(x + o)

with L_b the values of band b, r the NIR and red-edge references, o the offsets in 3 x 3 pixels. A morphological opening
has replaced strong glint before. The signal that remains is faint glint, swell and reflected sky. It varies over long
distances, so no local mean is subtracted for the fit of the kernels k. It is symmetric about its level p_b0, so that
p_b - p_b0 may be negative. The kernels minimise the sum, over squares of pixels of the sample, of the root mean square
residual in the square. Least squares would give much more weight to squares that contain an object.

This variant of the method wiener is used after an opening (`deglint.compensate`). It fails where the references show
the bottom. Red edge is not used if it would remove a turbid plume that is added to the sample for a test.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..errors import FitError
from ..moments import Float64
from .further import longest_that
from .kernels import LagGrams, gather, merge, offsets, solve, unexplained
from .levels import LEAST_GLINT, span_of
from .model import BandFit, GlintIndex, GlintModel
from .predict import predictions
from .reference import fit_reference
from .request import FitRequest
from .wiener import SampleTile

MIXTURE_SIDE = 3  # side of the kernels [pixel]
REWEIGHTED = 5  # iterations of reweighting: the error on simulated seas changes by less than 1 % after the third
LEAST_LEFT = 0.1  # lower limit of the mean square residual of a square, over the median: no square may dominate
TURBID = np.array([(400, 0.3), (490, 0.5), (560, 1.0), (660, 1.0), (710, 0.6), (740, 0.2), (850, 0.1)])
"""Wavelength [nm] and relative brightness of a plume of sediment, bright from the green to the red."""
PLUME = 0.5  # brightness of a plume relative to the water
WATER_PERCENTILE = 10.0  # percentile of a band over the sample that estimates the water without glint [%]
SKEWED, CLEAR = 0.15, 1.0
"""If the span of the predictions (see `levels.MOSTLY_CLEAR`) is less than `SKEWED`, some water has no glint, and the
share of this water is set to at least `CLEAR` %."""
DARK_PERCENTILE = 5.0
"""Percentile of the results over the sample [%]. The removal makes no pixel darker than this: where a clump of glint
fills the window in the NIR only, the prediction is too large. Pixels that were darker before keep their values."""
LEAST_KEPT = 0.75
"""Red edge is used if at least this share of a plume added to every tile is left; smaller plumes are changed less."""


def fit(request: FitRequest, tiles: list[SampleTile], clear: float, cut: Sequence[float] | None = None) -> GlintModel:
    """Fit kernels and levels to tiles after an opening; the model may also add light (`GlintModel.signed`).

    clear : share of the sample without glint, 0..1. Smaller shares are raised to `LEAST_GLINT` % (to `CLEAR` % if
        predictions are skewed, see `SKEWED`). The level of a band is the median of its prediction over this share
        of the pixels: those with the smallest sum of the predictions of all bands
    cut : for each band of the scene, how much the opening decreased its mean by replacing noise above the background.
        This is added to the level [unit of the band]

    Raises FitError if there is too little water.

    Hedley, Harborne, Mumby (2005), International Journal of Remote Sensing 26, 2107-2112,
    doi:10.1080/01431160500034086 (one reference, one pixel); Holland, Welsch (1977), Communications in Statistics A6,
    813-827, doi:10.1080/03610927708827533 (iteratively reweighted least squares).
    """
    nir = tuple(dict.fromkeys(b for i in request.indexes for b in i.bands))
    longer = longest_that(request, lambda more: _plume_gain(request, tiles, nir, more) >= LEAST_KEPT)
    model, every = _fitted(request, tiles, nir, longer), (*nir, *longer)
    measured = (fit_reference(((t.block[r], t.sample) for t in tiles), r) for r in every)
    rules = tuple(replace(rule, limit=np.inf, least=np.inf) for rule in measured)  # no pixel is too bright for glint
    references = ({r: t.block[r] for r in every} for t in tiles)
    parts = [[p[t.sample] for p in predictions(r, model)] for r, t in zip(references, tiles, strict=True)]
    found = np.concatenate(parts, axis=1)
    together = found.sum(axis=0)
    least = together <= np.percentile(together, max(100 * clear, CLEAR if span_of(together) < SKEWED else LEAST_GLINT))
    levels = np.median(found[:, least], axis=1).tolist()
    if cut is not None:
        levels = [level + cut[fit.band] for level, fit in zip(levels, model.fits, strict=True)]
    indexes, fits = [], []
    for i, f, p, level in zip(model.indexes, model.fits, found, levels, strict=True):
        left = np.concatenate([t.block[f.band][t.sample] for t in tiles]) - (p - level)
        indexes.append(replace(i, level=level))
        fits.append(replace(f, floor=float(np.percentile(left, DARK_PERCENTILE))))
    return replace(model, indexes=tuple(indexes), fits=tuple(fits), references=rules)


def _fitted(request: FitRequest, tiles: list[SampleTile], nir: tuple[int, ...], more: tuple[int, ...]) -> GlintModel:
    """Fit kernels of each band on bands `nir` and those of `more` with longer wavelengths (0-based); levels are 0."""
    every = (*nir, *more)
    sides = [MIXTURE_SIDE] * len(every)
    parts = [gather([*t.block[[*every]]], [*t.block[[*request.correct]]], t.sample, sides=sides) for t in tiles]
    grams = merge(parts)
    if not len(grams.grams):
        raise FitError("too little water in one piece to fit a removal to. Pass --sample with a piece of open water.")
    total, indexes, fits = grams.grams.sum(axis=0), [], []
    for place, band in enumerate(request.correct):
        own = request.bands[band].wavelength or 0.0
        used = [k for k, r in enumerate(every) if r in nir or (request.bands[r].wavelength or 0.0) > own]
        inputs, output = [c for k in used for c in grams.columns(k, MIXTURE_SIDE)], [grams.outputs[place]]
        weights = _robust(grams, inputs, output)
        power = float(total[output[0], output[0]])
        r2 = 1 - float(unexplained(total, inputs, output, weights)[0]) / power if power > 0 else 0.0
        bands = tuple(every[k] for k in used for _ in offsets(MIXTURE_SIDE))
        indexes.append(GlintIndex(bands, tuple(map(float, weights[:, 0])), 0.0, offsets(MIXTURE_SIDE) * len(used)))
        fits.append(BandFit(band, request.bands[band].name, place, 1.0, None, r2, int(grams.pixels.sum())))
    return GlintModel("wiener", tuple(indexes), tuple(fits), request.names, signed=True)


def _robust(grams: LagGrams, inputs: list[int], output: list[int]) -> Float64:
    """Coefficients (input, 1; see `solve`) with the least sum, over squares of pixels, of RMS residuals."""
    weight = np.ones(len(grams.grams))
    for _ in range(REWEIGHTED):
        found = solve((weight[:, None, None] * grams.grams).sum(axis=0), inputs, output)  # same for any threads
        left = unexplained(grams.grams, inputs, output, found)[:, 0] / grams.pixels
        least = LEAST_LEFT * float(np.median(left))
        if not least > 0:
            break
        weight = 1 / np.sqrt(np.maximum(left, least))
    return found


def _plume_gain(request: FitRequest, tiles: Sequence[SampleTile], nir: tuple[int, ...], more: tuple[int, ...]) -> float:
    """Least share, over bands, of a simulated plume that is left after a removal with references `nir` and `more`."""
    bands = range(len(request.bands))
    level = [np.percentile(np.concatenate([t.block[b][t.sample] for t in tiles]), WATER_PERCENTILE) for b in bands]
    waves = np.array([b.wavelength or 0.0 for b in request.bands])
    plume = PLUME * np.maximum(level, 0) * np.interp(waves, *TURBID.T)
    turbid = []
    for tile in tiles:
        rows, columns = (np.arange(n) - n / 2 for n in tile.sample.shape)
        shape = np.exp(-(rows[:, None] ** 2 + columns**2) / (2 * (min(tile.sample.shape) / 5) ** 2))
        turbid.append(replace(tile, block=tile.block + (plume[:, None, None] * shape).astype(tile.block.dtype)))
    found = _fitted(request, turbid, nir, more)
    kept = []
    for index, fit in zip(found.indexes, found.fits, strict=True):
        if fit.band not in more and plume[fit.band] > 0:
            taken = sum(w * plume[b] for b, w in zip(index.bands, index.weights, strict=True))
            kept.append(1 - float(taken / plume[fit.band]))
    return min(kept, default=0.0)
