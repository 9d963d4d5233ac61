r"""Wiener filter: every band follows a small neighbourhood of the NIR (and of a second reference), not its one pixel.

.. math:: L'_b = L_b - \max(p_b - p_{b0}, 0), \qquad p_b(x) = \sum_r \sum_o k_{bro} R_r(x + o)

R_r is a reference: the NIR that is taken with the band, then SWIR or another NIR where there is one, with ships, surf
and land replaced by the water around (`deglint.remove.reference`). The kernels k are least squares over open water,
with a local mean subtracted from every band. One kernel so finds and applies what displaces or blurs the glint of one
band against that of another - band delay, parallax, misregistration, unequal resolution - and averages the noise of
the reference. With a kernel of one pixel, raw statistics and the minimum as level it is Hedley's method.

- Kernels of 1, 3 and 5 pixels are compared on squares of the sample that they were not fitted to; the plainest that is
  within chance of the best is taken.
- The colour of glint is known to a fifth: that of the sun in radiance, or grey in reflectance. The response of each
  band to even glint is drawn toward it by its own uncertainty. All bands are corrected, or none.
- One level for all bands: the prediction where it is least, at the same pixels; raised until no band becomes negative.
  Glint is never negative, so nothing is added where the prediction is below the level.

Fails where strips of the scene have other delays and are not known, for a homogeneous sheet of glint (whose level no
image tells), for a wrong water mask, and over very shallow water, where the NIR sees the bottom. Costs one pass over
0.3 million pixels for the fit.

References
----------
Hedley, Harborne, Mumby (2005), International Journal of Remote Sensing 26, 2107-2112, doi:10.1080/01431160500034086
(one pixel of the NIR); Wiener (1949), Extrapolation, Interpolation, and Smoothing of Stationary Time Series, MIT
Press (least squares over a neighbourhood); Efron, Stein (1981), Annals of Statistics 9, 586-596,
doi:10.1214/aos/1176345462 (jackknife).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..errors import FitError
from ..scene import Band, FloatArray
from .detrend import SIZE as LOCAL_MEAN
from .detrend import detrend
from .lags import LagGrams, gather, merge, offsets, solve, unexplained
from .levels import even_share
from .model import BandFit, GlintIndex, GlintModel
from .predict import predicted
from .reference import ReferenceRule, clean, fit_reference
from .request import EVEN, FitRequest
from .strips import LEAST as LEAST_SQUARES
from .strips import Strips, find_kernels, second_kind

Float64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

SAMPLE_SIDE = 192
"""Side of the tiles of a sample [pixel]."""
SUPPORTS = ((1,), (3,), (3, 1), (3, 3), (5,), (5, 3))
"""Sides of the kernels on the first and on the second reference, plainest first [pixel]."""
WORTH = 0.01
"""Relative noise that a wider kernel, a second reference, or any removal at all must save."""
GROUPS = 16
"""Groups of squares that are left out in turn: an error estimated from 16 is itself known to 18 %."""
SURE = 3.0
"""Standard errors by which the glint that the bands share must exceed zero."""
COLOUR = 0.2
"""Relative uncertainty of the colour of glint: aerosol that is not known changes blue against NIR by a fifth."""
SUN_ZENITH = 40.0
"""Of the expected colour, which changes by less than `COLOUR` from 20 to 60 degrees [degree]."""
FAR_OUT = 8.0
"""Robust standard deviations from the local mean beyond which a pixel teaches nothing: a ship, surf, a rare flash."""
LEAST_GLINT = 0.2
"""Percent of the sample with the least glint, whose median prediction is the level [%]."""
NEGATIVE = 0.1
"""Percent of the calmer half of the sample that may be zero or less in a band after removal [%]. There the level
decides; under strong glint it is the error of the kernels that makes a pixel negative."""
SHEET = 0.5
"""Glint-free NIR over green after removal, from which on an even sheet of glint may hide in it. Clear and moderately
turbid water has .05 to .4, with the light that the air scatters."""
COARSE_EDGE = 2
"""Width of mixed pixels of a SWIR band, which most sensors have at half the resolution [pixel]."""


@dataclass(frozen=True, eq=False)
class SampleTile:
    """A part of a scene to learn from.

    Attributes
    ----------
    block : (band, row, column) ndarray
        Physical values of all bands of the scene, NaN where not valid.
    water : (row, column) ndarray of bool
        Where references show water.
    sample : (row, column) ndarray of bool
        Water to learn from: away from shores, or the sample that the user named.
    origin : (int, int)
        Row and column of the tile in the scene [pixel].
    """

    block: FloatArray
    water: Mask
    sample: Mask
    origin: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class _BandSet:
    """Bands that follow the same references; `bands` are places among the request's bands to correct."""

    references: tuple[int, ...]
    bands: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class _SetFit:
    """Kernels of one set: coefficients (variable, band), responses to even glint, all and without each group."""

    band_set: _BandSet
    support: tuple[int, ...]
    coefficients: Float64
    response: Float64
    left_out: Float64
    loss: Float64
    pixels: int


@np.errstate(over="ignore", divide="ignore", invalid="ignore")  # of degenerate samples, which are refused
def fit(
    request: FitRequest,
    tiles: Sequence[SampleTile],
    *,
    supports: Sequence[tuple[int, ...]] = SUPPORTS,
    strips: Strips | Callable[[StripFinder], Strips] | None = None,
) -> GlintModel:
    """Fit kernels, responses and level.

    Parameters
    ----------
    request : FitRequest
        With regression "ols" the statistics are raw, and the colour is not drawn to the expected one.
    tiles : sequence of SampleTile
        Spread over the scene; 0.3 million pixels are enough.
    supports : sequence of tuple of int
        Sides of the kernels that are compared; see `SUPPORTS`.
    strips : Strips or callable, optional
        Where detectors have opposite delays: a kernel for each kind of strip. Or what finds it out in all of the scene,
        called where the sample shows two kinds.

    Returns
    -------
    GlintModel
        Without fits where the glint that the bands share is not significant, or not worth removing.

    Raises
    ------
    FitError
        Too little open water.
    """
    sets = band_sets(request)
    learnt, rules = _prepared(request, tiles, sets)
    grams = [_gathered(s, learnt, request) for s in sets]
    if callable(strips):
        kernels = find_kernels(grams[0], len(sets[0].bands))
        strips = None if kernels is None else strips(StripFinder(request, rules, kernels))
    kinds = [grams] if strips is None else _by_strip(grams, strips)
    found = [[f for s, g in zip(sets, some, strict=True) for f in _fit_set(s, g, supports)] for some in kinds]
    response, covariance = _joined([f for some in found for f in some], len(request.correct))
    shared = _shared_glint(response, covariance, request, sets)
    model = _model(request, found[0], rules, shared, covariance)
    if len(found) > 1:
        second = _model(request, found[1], rules, shared, covariance)
        used = {r.band for m in (model, second) for r in m.references}
        both = tuple(rule for r, rule in rules.items() if r in used)
        model = replace(model, strips=strips, second=second.indexes, references=both)
    loss = np.concatenate([f.loss for some in found for f in some])
    noise = float(np.exp(np.log(np.maximum(loss, 1e-12)).mean() / 2))
    if shared.significance <= SURE or noise > 1 - WORTH:
        return _nothing(model, f"the NIR takes {1 - noise:.1%} off the noise of the bands: they share no glint")
    return _with_level(model, learnt, request)


@dataclass(frozen=True, eq=False)
class StripFinder:
    """Tells for any tile of a scene which of its squares lie in strips of the second kind."""

    request: FitRequest
    rules: dict[int, ReferenceRule]
    kernels: tuple[Float64, Float64]

    def __call__(self, tile: SampleTile) -> tuple[npt.NDArray[np.int64], Mask]:
        """Row and column in the scene of squares with enough water, and whether they are of the second kind."""
        try:
            grams = _gathered(band_sets(self.request)[0], [_learnt(tile, self.request, self.rules)], self.request)
        except FitError:
            return np.zeros((0, 2), np.int64), np.zeros(0, np.bool_)
        return grams.places, second_kind(grams, self.kernels)


def _prepared(
    request: FitRequest, tiles: Sequence[SampleTile], sets: Sequence[_BandSet]
) -> tuple[list[_Learnt], dict[int, ReferenceRule]]:
    """Tiles with cleaned references and without what teaches nothing."""
    rules = _rules(request, tiles, sets)
    learnt = [_learnt(tile, request, rules) for tile in tiles]
    limits = _limits(learnt)
    return [_without_outliers(tile, limits) for tile in learnt], rules


def _gathered(band_set: _BandSet, learnt: Sequence[_Learnt], request: FitRequest) -> LagGrams:
    size = 0 if request.regression == "ols" else LOCAL_MEAN
    parts = [
        gather(
            [t.references[r] for r in band_set.references], [t.bands[b] for b in band_set.bands], t.teaches,
            size=size, origin=t.origin,
        )
        for t in learnt
    ]  # fmt: skip
    grams = merge(parts) if parts else None
    if grams is None or not len(grams.grams):
        raise FitError(
            "too little open water to learn from: no square of 64 x 64 pixels holds enough. Pass --sample with a "
            "polygon or window over open water, or --mask with what is water."
        )
    return grams


def _by_strip(grams: Sequence[LagGrams], strips: Strips) -> list[list[LagGrams]]:
    """The squares of each kind of strip; all together where one kind has too few."""
    second = strips.of_cells(grams[0])
    if min(int(second.sum()), int((~second).sum())) < LEAST_SQUARES:
        return [list(grams)]
    return [[g.some(second == kind) for g in grams] for kind in (False, True)]


def without_even(model: GlintModel, request: FitRequest, tiles: Sequence[SampleTile]) -> GlintModel:
    """The model without its fits, where what it would remove lies evenly about its median.

    For pixels so fine that sparkle is resolved and none was found: glint is skewed there, and what the bands share
    evenly is the sky that waves mirror, which belongs to the image.
    """
    rules = {r.band: r for r in model.references}
    learnt = [_learnt(tile, request, rules) for tile in tiles]
    strength = [np.mean(_predictions(model, t), axis=0)[t.sample] for t in learnt]
    share = even_share(np.concatenate(strength))
    if share <= EVEN:
        return model
    return _nothing(model, f"{min(share, 1):.0%} of what would be removed lies evenly, as mirrored sky does")


def _nothing(model: GlintModel, why: str) -> GlintModel:
    return replace(model, fits=(), references=(), warnings=(f"{why}. Nothing was corrected.",))


def band_sets(request: FitRequest) -> list[_BandSet]:
    """Bands by what they follow: the NIR taken with them, then SWIR or another NIR that is not itself corrected."""
    out: dict[tuple[int, ...], list[int]] = {}
    for place, follows in enumerate(request.follows):
        first = request.indexes[follows or 0].bands[0]
        others = [i for i, b in enumerate(request.bands) if i != first and i not in request.correct and _serves(b)]
        others.sort(key=lambda i: _preference(request.bands[i]))
        out.setdefault((first, *others[:1]), []).append(place)
    return [_BandSet(references, tuple(bands)) for references, bands in out.items()]


def _serves(band: Band) -> bool:
    """Whether a band shows glint and nothing of the water: from 750 nm on, outside the bands of water vapour."""
    if not band.wavelength or band.wavelength < 750:
        return False
    narrow = band.width is not None and band.width < 40
    vapour = 1340 <= band.wavelength <= 1420 or (narrow and 925 <= band.wavelength <= 965)
    return not vapour and band.wavelength <= 2400


def _preference(band: Band) -> tuple[int, float]:
    """SWIR first, near 1610 nm: it does not see turbid water. Then a second NIR."""
    assert band.wavelength is not None
    return (0, abs(band.wavelength - 1610)) if band.wavelength > 1100 else (1, abs(band.wavelength - 865))


def _rules(request: FitRequest, tiles: Sequence[SampleTile], sets: Sequence[_BandSet]) -> dict[int, ReferenceRule]:
    used = sorted({r for s in sets for r in s.references})
    samples = [(t.block, t.sample & np.isfinite(t.block[used]).all(axis=0)) for t in tiles]
    rules = {}
    for r in used:
        coarse = (request.bands[r].wavelength or 0) > 1100
        rules[r] = fit_reference([(b[r], m) for b, m in samples], r, edge=COARSE_EDGE if coarse else 1)
    return rules


@dataclass(frozen=True, eq=False)
class _Learnt:
    """A tile with cleaned references; the sample of the level, and that of the kernels."""

    references: dict[int, FloatArray]
    bands: list[FloatArray]
    sample: Mask
    teaches: Mask
    origin: tuple[int, int]


def _learnt(tile: SampleTile, request: FitRequest, rules: dict[int, ReferenceRule]) -> _Learnt:
    references, sample = {}, tile.sample & np.isfinite(tile.block[[*request.correct, *rules]]).all(axis=0)
    for r, rule in rules.items():
        references[r], exceeds = clean(tile.block[r], tile.water, rule)
        if exceeds is not None:
            sample = sample & ~exceeds
    return _Learnt(references, [tile.block[b] for b in request.correct], sample, sample, tile.origin)


def _limits(learnt: Sequence[_Learnt]) -> list[float]:
    """Of every reference, then every band: the deviation from its local mean beyond which a pixel teaches nothing."""
    planes = [list(t.references.values()) + t.bands for t in learnt]
    out = []
    for k in range(len(planes[0]) if planes else 0):
        away = [np.abs(detrend(p[k][None], t.sample)[0][t.sample]) for p, t in zip(planes, learnt, strict=True)]
        together = np.concatenate(away)
        out.append(FAR_OUT * 1.4826 * float(np.median(together)) if together.size else np.inf)
    return out


def _without_outliers(tile: _Learnt, limits: Sequence[float]) -> _Learnt:
    import cv2

    if not tile.sample.any():
        return tile
    away = np.abs(detrend(np.stack([*tile.references.values(), *tile.bands]), tile.sample))
    with np.errstate(invalid="ignore"):
        far = (away > np.array(limits)[:, None, None]).any(axis=0)
    near = np.asarray(cv2.dilate(np.asarray(far, np.uint8), np.ones((5, 5), np.uint8))).view(np.bool_)
    return replace(tile, teaches=tile.sample & ~near)


def _fit_set(band_set: _BandSet, grams: LagGrams, supports: Sequence[tuple[int, ...]]) -> list[_SetFit]:
    """The kernels of a set of bands, for each support that suits some of them best."""
    outputs = [grams.band(i) for i in range(len(band_set.bands))]
    count = min(GROUPS, len(grams.grams))
    groups = [grams.grams[i * len(grams.grams) // count : (i + 1) * len(grams.grams) // count].sum(axis=0)
              for i in range(count)]  # fmt: skip
    total = np.sum(groups, axis=0)
    usable = [s for s in supports if len(s) <= grams.references and total[grams.centre(len(s) - 1)].any()]
    if not usable or not np.isfinite(total).all():
        raise FitError(
            "the NIR does not vary over the sample, or its squares are beyond double precision, so no kernel can be "
            "fitted. Choose another --nir, or a --sample where glint varies."
        )
    losses = {s: _held_out(groups, total, _inputs(grams, s), outputs) for s in usable}
    chosen = _supports(losses)
    out = []
    for support in dict.fromkeys(chosen):
        mine = [k for k, s in enumerate(chosen) if s == support]
        wanted = [outputs[k] for k in mine]
        left_out = [_response(grams, total - g, support, wanted) for g in groups] if count > 1 else []
        out.append(
            _SetFit(
                _BandSet(band_set.references, tuple(band_set.bands[k] for k in mine)),
                support,
                solve(total, _inputs(grams, support), wanted),
                _response(grams, total, support, wanted),
                np.array(left_out),
                losses[support].sum(axis=0)[mine],
                int(grams.pixels.sum()),
            )
        )
    return out


def _inputs(grams: LagGrams, support: tuple[int, ...]) -> list[int]:
    return [c for reference, side in enumerate(support) for c in grams.columns(reference, side)]


def _held_out(groups: Sequence[Float64], total: Float64, inputs: list[int], outputs: list[int]) -> Float64:
    """Power (group, band) that a fit to the other groups leaves in each, over the power of the band in all."""
    power = np.maximum(total[outputs, outputs], np.finfo(float).tiny)
    alone = len(groups) == 1
    left = [unexplained(g, inputs, outputs, solve(total if alone else total - g, inputs, outputs)) for g in groups]
    return np.array(left) / power


def _supports(losses: dict[tuple[int, ...], Float64]) -> list[tuple[int, ...]]:
    """The support of each band: that which suits all of them, but where a band clearly wants another.

    losses : of each support, the relative power that it leaves, (group, band)
    """
    power = {s: np.maximum(loss.sum(axis=0), 1e-12) for s, loss in losses.items()}
    least = np.min(list(power.values()), axis=0)
    common = _within_chance({s: (loss / least).mean(axis=1) for s, loss in losses.items()})[0]
    out = []
    for k in range(len(least)):
        own = _within_chance({s: loss[:, k] / least[k] for s, loss in losses.items()})
        out.append(common if common in own else own[0])
    return out


def _within_chance(losses: dict[tuple[int, ...], Float64]) -> list[tuple[int, ...]]:
    """The supports, plainest first, that leave at most `WORTH` more noise than the best, or not more beyond chance.

    losses : of each support, the power that it leaves in each group
    """
    least = min(losses, key=lambda s: float(losses[s].sum()))
    best, out = losses[least], []
    for support, loss in losses.items():
        excess = (loss - best) / max(best.sum(), np.finfo(float).tiny)  # 0 where a band is constant
        chance = np.sqrt(len(excess)) * excess.std(ddof=1) if len(excess) > 1 else np.inf
        if excess.sum() <= max(2 * WORTH, chance):
            out.append(support)
    return out or [least]  # losses that are not finite


def _response(grams: LagGrams, gram: Float64, support: tuple[int, ...], outputs: list[int]) -> Float64:
    """How each band follows a rise of 1 in its NIR everywhere; the second reference rises as it follows the first."""
    inputs = _inputs(grams, support)
    coefficients = solve(gram, inputs, outputs)
    first = grams.columns(0, support[0])
    out, start = np.zeros(len(outputs)), 0
    for reference, side in enumerate(support):
        rise = 1.0 if reference == 0 else float(solve(gram, first, [grams.centre(reference)]).sum())
        out += rise * coefficients[start : start + side * side].sum(axis=0)
        start += side * side
    return out


def _joined(found: Sequence[_SetFit], bands: int) -> tuple[Float64, Float64]:
    """Responses of all bands, the mean over strips, and their covariance by the jackknife over groups."""
    share = np.zeros(bands)
    for f in found:
        share[list(f.band_set.bands)] += f.pixels
    groups = min((len(f.left_out) for f in found), default=0)
    response, left_out = np.zeros(bands), np.zeros((groups, bands))
    for f in found:
        mine = list(f.band_set.bands)
        response[mine] += f.response * f.pixels / share[mine]
        if groups:
            left_out[:, mine] += f.left_out[:groups] * f.pixels / share[mine]
    if groups < 2:
        return response, np.diag(response**2)
    away = left_out - left_out.mean(axis=0)
    return response, (groups - 1) / groups * away.T @ away


@dataclass(frozen=True, eq=False)
class _Shared:
    """The glint that all bands share: weights of the bands in it, responses drawn to its colour, its significance."""

    weights: Float64
    response: Float64
    significance: float


def _shared_glint(response: Float64, covariance: Float64, request: FitRequest, sets: Sequence[_BandSet]) -> _Shared:
    """Generalised least squares for the strength of glint of known colour, then the posterior mean of each band.

    Radiance and reflectance are told apart by which of the two colours fits.
    """
    tiny = 1e-12 * max(float(np.trace(covariance)), np.finfo(float).tiny) * np.eye(len(response))
    if request.regression == "ols":
        weights = np.linalg.pinv(covariance + tiny) @ response
        return _Shared(weights, response, _significance(weights, response, covariance))
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
        shared = _Shared(weights, posterior, _significance(weights, response, covariance))
        tried.append((float(away @ scaled), shared))
    return min(tried, key=lambda t: t[0])[1]


def _significance(weights: Float64, response: Float64, covariance: Float64) -> float:
    spread = float(weights @ covariance @ weights)
    return float(weights @ response) / np.sqrt(spread) if spread > 0 else np.inf


def _colours(request: FitRequest, sets: Sequence[_BandSet]) -> list[Float64]:
    """Glint in each band over that in the NIR it follows: grey (reflectance), and the sun's colour (radiance)."""
    from ..physics.atmosphere import irradiance

    grey = np.ones(len(request.correct))
    follows = {b: s.references[0] for s in sets for b in s.bands}
    pairs = [(request.bands[b].wavelength, request.bands[follows[i]].wavelength) for i, b in enumerate(request.correct)]
    if not all(w and 300 <= w <= 1000 for pair in pairs for w in pair):
        return [grey]
    own, nir = (irradiance(np.array(w, float), SUN_ZENITH).direct for w in zip(*pairs, strict=True))
    return [grey, own / nir]


def _model(
    request: FitRequest, found: Sequence[_SetFit], rules: dict[int, ReferenceRule], shared: _Shared, covariance: Float64
) -> GlintModel:
    """Kernels of the posterior responses: what is added has the kernel of the glint that the bands share."""
    indexes: dict[int, GlintIndex] = {}
    fits: dict[int, BandFit] = {}
    errors = np.sqrt(np.maximum(np.diag(covariance), 0))
    for f in found:
        mine = list(f.band_set.bands)
        weights, target = shared.weights[mine], shared.response[mine]
        strength = float(weights @ f.response)
        common = f.coefficients @ (weights / strength) if strength > 0 else f.coefficients.mean(axis=1)
        kernels = f.coefficients + np.outer(common, target - f.response)
        at = [(r, o) for r, side in zip(f.band_set.references, f.support, strict=False) for o in offsets(side)]
        for k, place in enumerate(f.band_set.bands):
            slope = float(target[k]) if target[k] > 0 else 1.0
            kernel = tuple(float(c) / slope for c in kernels[:, k])
            indexes[place] = GlintIndex(tuple(r for r, _ in at), kernel, 0.0, tuple(o for _, o in at))
            band = request.correct[place]
            error, r2 = float(errors[mine][k]), float(1 - f.loss[k])
            fits[place] = BandFit(band, request.bands[band].name, place, slope, error, r2, f.pixels)
    places = range(len(request.correct))
    used = {b for i in indexes.values() for b in i.bands}
    return GlintModel(
        "wiener", tuple(indexes[p] for p in places), tuple(fits[p] for p in places), request.names,
        references=tuple(rule for r, rule in rules.items() if r in used),
    )  # fmt: skip


def _predictions(model: GlintModel, tile: _Learnt) -> list[FloatArray]:
    """What each index predicts in a tile."""
    return [predicted(tile.references, model, k, tile.origin) for k in range(len(model.indexes))]


def _with_level(model: GlintModel, learnt: Sequence[_Learnt], request: FitRequest) -> GlintModel:
    """One level for all bands, from the pixels of the sample where their predictions together are least."""
    slopes = np.array([f.slope for f in model.fits])
    predictions, values = [], []
    for tile in learnt:
        if tile.sample.any():
            predictions.append(np.stack(_predictions(model, tile))[:, tile.sample])
            values.append(np.stack([band[tile.sample] for band in tile.bands]))
    prediction, value = np.concatenate(predictions, axis=1), np.concatenate(values, axis=1)  # (band, pixel)
    together = slopes @ prediction / slopes.sum()  # in units of the NIR
    least = together <= np.percentile(together, LEAST_GLINT)
    level = np.median(prediction[:, least], axis=1)
    raised = float(np.median(together[least]))
    middle = float(np.median(together))
    short = [
        float(np.percentile((p - v / s)[inside], 100 - NEGATIVE)) - at
        for p, v, s, at in zip(prediction, value, slopes, level, strict=True)
        if (inside := (v > 0) & (together <= middle)).any()
    ]  # fmt: skip
    lift = max([0.0, *short])
    lowest, chosen = raised + max(short, default=0.0), raised + lift
    interval = max(float(lowest), 0.0), float(chosen), middle
    levels = [float(at + lift) for at in level]
    indexes = tuple(replace(i, level=at) for i, at in zip(model.indexes, levels, strict=True))
    second = tuple(replace(i, level=at) for i, at in zip(model.second, levels, strict=False))
    green = min(range(len(slopes)), key=lambda k: abs((request.bands[request.correct[k]].wavelength or 560.0) - 560.0))
    clean = float(np.median(value[green] - slopes[green] * np.maximum(prediction[green] - indexes[green].level, 0)))
    return replace(model, indexes=indexes, second=second, level_interval=interval, warnings=_sheet(interval, clean))


def _sheet(interval: tuple[float, float, float], green: float) -> tuple[str, ...]:
    """A warning where the glint-free NIR may hide an even sheet of glint; `green` is the band after removal."""
    lowest, chosen, middle = interval
    if chosen <= SHEET * green:
        return ()
    said = (
        f"the level of the glint is uncertain: the least NIR over water, {chosen:.4g}, is "
        f"{chosen / max(green, 1e-9):.0%} of the green. Turbid water or haze may be so bright; if it is an even sheet "
        f"of glint, the glint-free NIR is between {lowest:.4g} and {middle:.4g}, and much of the sheet is left."
    )
    return (said,)
