r"""Wiener filter: each band's glint is predicted from a small neighbourhood of the NIR (and of a second reference).

.. math:: L'_b = L_b - \max(p_b - p_{b0}, 0), \qquad p_b(x) = \sum_r \sum_o k_{bro} R_r(x + o)

R_r is a reference, read at the offsets o: the NIR taken at the time of the band, then SWIR or another NIR if there is
one, with ships, surf and land replaced by the water around (`deglint.remove.reference`). The kernels k are fitted by
least squares over open water, minus a local plane in every band (`deglint.remove.kernels`). They model displacement and
blur between the glint of two bands, and average the noise of the reference. The sum of a kernel (response to uniform
glint) is shifted toward the spectrum of glint (`spectrum`). All bands are corrected, or none. The levels p_b0, and
lower limits of L'_b, are in `levels`. With one pixel, no plane and the minimum as level it is Hedley's method.

The method fails for unknown strips with other band delays, for a homogeneous sheet of glint (no image shows its level),
for a wrong water mask, and over very shallow water, where the NIR shows the bottom. A fit reads 300,000 pixels.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from ..errors import NoWaterError
from ..moments import CELL, Float64, Mask
from ..morphology import box_sum, grown
from ..scene import Band, FloatArray
from . import kernels
from .detrend import LOCAL_MEAN, detrend, detrend_plane
from .kernels import BandSet, KernelFit, LagGrams, fit_kernels, gather, joined, kernel_squares, merge, offsets
from .levels import AVERAGED, LevelSample, apart_from_sparkle, floors, shared_level, shared_level_error
from .model import BandFit, GlintIndex, GlintModel
from .noise import faint_weight
from .predict import predictions
from .reference import QUARTILE, ReferenceRule, clean, fit_reference, largest_glint, open_squares
from .request import FitRequest
from .spectrum import ROUNDING, CommonGlint, shared_glint
from .strips import LEAST_SQUARES_OF_KIND, Strips, find_kernels, second_is_better

SquareKinds = Callable[["SampleTile"], tuple[npt.NDArray[np.int64], Mask]]
"""Function that returns, for a tile, row and column in the scene of each square of `CELL` pixels, (square, 2), and a
mask (square,) of the squares in strips of the second kind (`deglint.remove.strips`)."""
SAMPLE_SIDE = 192  # side of the tiles of a sample [pixel]
SURE = 3.0  # standard errors by which the glint common to the bands must exceed zero, else nothing is corrected
SHEET = 0.5
"""Ratio of glint-free NIR to green after removal above which there is a warning: the NIR may contain an even sheet of
glint. Clear and moderately turbid water has .05 to .4, including light scattered by the air."""
UNLIKE = 40.0
"""Ratio of a band's local variance that the NIR does not explain to the lower quartile of this variance in the sample.
Where the ratio is larger, the NIR shows the bottom or sediment: glint varies less if pixels are wider than waves."""
SHORTEST_SWIR = 1100.0  # shortest wavelength of SWIR [nm]: the limit of silicon detectors
COARSE_EDGE = 2  # width of mixed pixels of a SWIR band, which has half the resolution in most sensors [pixel]


@dataclass(frozen=True, eq=False)
class SampleTile:
    """A part of a scene to which a removal is fitted: the pixels, the mask of water, and the mask of the sample."""

    block: FloatArray  # (band, row, column) physical values of all bands of the scene, NaN where not valid
    water: Mask  # (row, column), True over water; references are replaced elsewhere
    sample: Mask  # (row, column), pixels used for fitting: water away from shores, or the sample given by the user
    origin: tuple[int, int] = (0, 0)  # row and column of the tile in the scene [pixel]


@dataclass(frozen=True, eq=False)
class _Cleaned:
    """A sample tile whose references (NIR, SWIR) no longer have ships, surf and land."""

    references: dict[int, FloatArray]  # (row, column) by 0-based band, without ships, surf and land
    bands: list[FloatArray]  # (row, column) of each band to correct
    sample: Mask  # (row, column): pixels for the level
    origin: tuple[int, int]  # row and column of the tile in the scene


class _KernelPlanes(NamedTuple):
    """Data of a sample tile for the fit of kernels."""

    sample: Mask  # (row, column): pixels for the kernels
    flat: Float64  # (plane, row, column): references, then bands, minus local planes unless regression is "ols"
    weights: dict[int, FloatArray]  # (row, column) by NIR band: weight of each pixel in a fit to faint glint, else {}


class Prepared(NamedTuple):
    """A request and a sample that is ready for fits: the rule of each reference, by its 0-based band, and the tiles."""

    request: FitRequest
    rules: dict[int, ReferenceRule]
    tiles: list[_Cleaned]
    planes: list[_KernelPlanes]  # of each tile
    notes: tuple[str, ...]  # warnings for the model


@np.errstate(over="ignore", divide="ignore", invalid="ignore")  # degenerate samples are refused later
def fit(request: FitRequest, tiles: Sequence[SampleTile]) -> GlintModel:
    """Fit the kernel of each band, its response (the sum of the kernel) and its glint-free level.

    request : with regression "ols" no local plane is subtracted, and responses are not shifted to the expected
        spectrum. The field `strips` is a map of the detector strips with opposite band delays, which get separate
        kernels; or a function that makes this map from a `SquareKinds`, called if the sample shows two kinds of strips
    tiles : parts of the scene, spread over it; 0.3 million pixels are enough

    Returns a model without fits if the glint common to the bands is not significant or not worth removing. Raises
    FitError for too little open water, a constant NIR, or sums of squares beyond double precision.

    Hedley, Harborne, Mumby (2005), International Journal of Remote Sensing 26, 2107-2112,
    doi:10.1080/01431160500034086 (one pixel of the NIR); Wiener (1949), Extrapolation, Interpolation, and Smoothing of
    Stationary Time Series, MIT Press (least squares over a neighbourhood); Efron, Stein (1981), Annals of Statistics 9,
    586-596, doi:10.1214/aos/1176345462 (jackknife).
    """
    ready = prepare(request, tiles)
    model, of_glint = fit_without_levels(ready)
    return _with_level(model, of_glint, ready.tiles, ready.request) if model.fits else model


def prepare(request: FitRequest, tiles: Sequence[SampleTile]) -> Prepared:
    """Prepare the tiles of a sample for fits with the references of `request`; fits may omit any of `request.more`."""
    request, notes = _without_constant(request, tiles)
    rules = _rules(request, tiles, list(dict.fromkeys(r for s in band_sets(request) for r in s.references)))
    cleaned = [_cleaned(tile, request, rules) for tile in tiles]
    inside = _trusted(cleaned, request)
    planes = [_kernel_planes(t, i, request) for t, i in zip(cleaned, inside, strict=True)]
    return Prepared(request, rules, cleaned, planes, notes)


@np.errstate(over="ignore", divide="ignore", invalid="ignore")  # as in `fit`
def fit_without_levels(ready: Prepared) -> tuple[GlintModel, Float64]:
    """Fit the model of `fit` to a prepared sample, with levels 0; also return the slopes of glint alone, (band,)."""
    request, rules, tiles, planes, notes = ready
    sets, strips = band_sets(request), request.strips
    grams = [_gathered(s, tiles, planes) for s in sets]
    if not all(len(g.grams) for g in grams):
        raise NoWaterError(
            "too little open water for a fit: it fills 15 % of no square of 64 x 64 pixels. Select more open water by "
            "--sample or --mask (polygons or a window), or take --method hedley --sample all."
        )
    if callable(strips):
        mirrored = find_kernels(grams[0])
        strips = None if mirrored is None else strips(partial(_kinds, request, rules, mirrored))
    kinds = [grams] if strips is None else _by_strip(grams, strips)
    fitted = [[k for s, g in zip(sets, some, strict=True) for k in fit_kernels(s, g)] for some in kinds]
    every = [k for some in fitted for k in some]
    response, covariance, loss = joined(every, len(request.correct))
    common = shared_glint(response, covariance, 1 - loss, request)
    if request.resolved:  # some pixels have no glint, so that its mean is in the texture
        common = common._replace(of_glint=np.minimum(common.of_glint, common.response))
    variance = float(common.weights @ covariance @ common.weights)
    sure = not variance > 0 or float(common.weights @ response) / np.sqrt(variance) > SURE
    model = replace(_model(request, fitted, common), strips=strips if len(fitted) > 1 else None, warnings=notes)
    model = replace(model, references=tuple(rule for r, rule in rules.items() if r in model.index_bands))
    left = float(np.exp(np.log(np.maximum(np.concatenate([k.loss for k in every]), 1e-12)).mean() / 2))
    if not sure or left > 1 - kernels.WORTH:
        why = ": they share no glint" if sure else ", which may be chance"
        said = f"the NIR explains {max(1 - left, 0):.1%} of the bands' variation{why}. Nothing was corrected."
        model = replace(model, fits=(), references=(), warnings=(*notes, said))
    return model, common.of_glint


def _without_constant(request: FitRequest, tiles: Sequence[SampleTile]) -> tuple[FitRequest, tuple[str, ...]]:
    """Delete wavelengths of constant or empty bands, so that such bands are no references; return request, warnings."""
    bands, notes = list(request.bands), []
    for i in set(range(len(bands))).difference(request.correct, request.nir):
        values = np.concatenate([t.block[i][t.sample] for t in tiles])
        if _serves(bands[i]) and not np.nanmin(values, initial=np.inf) < np.nanmax(values, initial=-np.inf):
            bands[i] = replace(bands[i], wavelength=None)
            notes.append(f"{bands[i].name} does not vary over the sample, so it is not used as a reference.")
    return replace(request, bands=tuple(bands)), tuple(notes)


def _rules(request: FitRequest, tiles: Sequence[SampleTile], references: Sequence[int]) -> dict[int, ReferenceRule]:
    """Rule for each reference, by its 0-based band, that says which pixels are too bright for glint."""
    known = [t.sample & np.isfinite(t.block[references]).all(axis=0) for t in tiles]
    rules = {}
    for r in references:
        edge = COARSE_EDGE if (request.bands[r].wavelength or 0) > SHORTEST_SWIR else 1
        blocks = [(t.block[r], mask) for t, mask in zip(tiles, known, strict=True)]
        smooth = request.sparkle and not request.faint_glint  # at coarse pixels, fine waves look like noise
        rules[r] = fit_reference(blocks, r, edge=edge, sparkle=request.faint_glint or request.sparkle, smooth=smooth)
    return rules


def _kinds(
    request: FitRequest, rules: dict[int, ReferenceRule], pair: tuple[Float64, Float64], tile: SampleTile
) -> tuple[npt.NDArray[np.int64], Mask]:
    """Row and column of each square of a tile, (square, 2); mask (square,), True if kernel 2 of `pair` fits better."""
    cleaned = _cleaned(tile, request, rules)
    grams = _gathered(band_sets(request)[0], [cleaned], [_kernel_planes(cleaned, cleaned.sample, request)])
    return grams.places, second_is_better(grams, pair)


def _gathered(band_set: BandSet, tiles: Sequence[_Cleaned], planes: Sequence[_KernelPlanes]) -> LagGrams:
    """`LagGrams` of a set of bands in all tiles."""
    sides = [max(s[k] for s in band_set.supports if len(s) > k) for k in range(len(band_set.references))]
    parts = []
    for tile, (sample, flat, weights) in zip(tiles, planes, strict=True):
        of_reference = [flat[list(tile.references).index(r)] for r in band_set.references]
        of_band, weight = [flat[len(tile.references) + b] for b in band_set.bands], weights.get(band_set.references[0])
        parts.append(gather(of_reference, of_band, sample, sides=sides, origin=tile.origin, weight=weight))
    return merge(parts)


def _by_strip(grams: Sequence[LagGrams], strips: Strips) -> list[list[LagGrams]]:
    """Split squares of `grams` (one per band set) by kind of strip: [kind][set]. They are not split if one is rare."""
    middle = grams[0].places + CELL // 2
    second = np.array([strips.share((r, r + 1), (c, c + 1))[0, 0] > 0.5 for r, c in middle], np.bool_)
    if min(int(second.sum()), int((~second).sum())) < LEAST_SQUARES_OF_KIND:
        return [list(grams)]
    return [[g.some(second == kind) for g in grams] for kind in (False, True)]


def band_sets(request: FitRequest) -> list[BandSet]:
    """Group the bands to correct by their references: their NIR, a SWIR or another NIR, and bands of `request.more`."""
    out: dict[tuple[int, ...], list[int]] = {}
    # the second reference is SWIR near 1610 nm, which does not show turbid water; if there is none, another NIR
    waves = [b.wavelength or 0.0 for b in request.bands]
    preference = [(0, abs(w - 1610)) if w > SHORTEST_SWIR else (1, abs(w - 865)) for w in waves]
    for place, first in enumerate(request.nir):
        others = [i for i, b in enumerate(request.bands) if i != first and i not in request.correct and _serves(b)]
        others.sort(key=lambda i: preference[i])
        own = waves[request.correct[place]] or np.inf
        longer = [i for i in request.more if i != first and waves[i] > own]
        out.setdefault(tuple(dict.fromkeys((first, *others[:1], *longer))), []).append(place)
    return [BandSet(references, tuple(bands), _supports_to_try(references, waves)) for references, bands in out.items()]


def _supports_to_try(references: tuple[int, ...], waves: Sequence[float]) -> tuple[tuple[int, ...], ...]:
    """Supports (side of the kernel on each of `references` [pixel]) to try; `waves`: wavelengths of all bands [nm]."""
    count = len(references)
    if count == 1:
        return kernels.SUPPORTS
    plain = kernels.WITH_SWIR if waves[references[1]] > SHORTEST_SWIR else kernels.SUPPORTS
    return plain if count == 2 else (*plain, *(sides * count for sides in ((1,), (3,))))


def _serves(band: Band) -> bool:
    """Whether a band shows no signal of the water: its wavelength is 750 to 2400 nm, outside water vapour bands."""
    wave, narrow = band.wavelength or 0.0, band.width is not None and band.width < 40
    vapour = 1340 <= wave <= 1420 or (narrow and 925 <= wave <= 965)
    return not vapour and 750 <= wave <= 2400


def _cleaned(tile: SampleTile, request: FitRequest, rules: dict[int, ReferenceRule]) -> _Cleaned:
    """Clean the references of a tile by `rules`, and exclude NaN and pixels too bright for glint from its sample."""
    references, sample = {}, tile.sample & np.isfinite(tile.block[[*request.correct, *rules]]).all(axis=0)
    for r, rule in rules.items():
        references[r], exceeds = clean(tile.block[r], tile.water, rule)
        if exceeds is not None:
            sample = sample & ~exceeds
    return _Cleaned(references, [tile.block[b] for b in request.correct], sample, tile.origin)


def _trusted(cleaned: Sequence[_Cleaned], request: FitRequest) -> list[Mask]:
    """Masks of the pixels to which kernels are fitted: the samples without outliers, and without water where the NIR
    shows the bottom. If this leaves no square (`kernel_squares`), the whole samples are used.
    In a fit to faint glint, outliers are kept, with little weight (`faint_weight`). If waves are resolved, pixels like
    those of a visible bottom are kept, as they may be glint.
    """
    every = inside = [t.sample for t in cleaned]
    if not (request.faint_glint and request.resolved):
        high = [detrend(np.stack([*t.references.values(), *t.bands]), t.sample) for t in cleaned]
        if not request.faint_glint:
            inside = _without_outliers(high, inside, sparkle=request.sparkle)
        if not request.resolved and any(i.any() for i in inside):
            inside = _without_bottom(high, inside, len(cleaned[0].references))
    return inside if any(any(kernel_squares(i)) for i in inside) else every


def _kernel_planes(tile: _Cleaned, sample: Mask, request: FitRequest) -> _KernelPlanes:
    """Subtract local planes from a tile, and weight its pixels, for a fit of kernels to the pixels `sample`."""
    flat = np.stack([*tile.references.values(), *tile.bands]).astype(np.float64)
    if request.regression != "ols":
        flat = detrend_plane(flat, sample)
    weights = {r: faint_weight(tile.references[r], tile.sample) for r in {*request.nir}} if request.faint_glint else {}
    return _KernelPlanes(sample, flat, weights)


def _without_outliers(high: Sequence[Float64], inside: Sequence[Mask], *, sparkle: bool) -> list[Mask]:
    """Masks `inside` without pixels at or near which the deviation `high` from local means is too large for glint."""
    every = list(zip(high, inside, strict=True))
    tops = [np.nanmax(np.abs(h[:, *square]), axis=(1, 2)) for h, i in every for square in open_squares(i)]
    if not tops:
        return list(inside)
    away = np.concatenate([np.abs(h[:, i]) for h, i in every], axis=1)
    limits: Float64 = np.array(
        [largest_glint(t, a, sparkle=sparkle) for t, a in zip(np.transpose(tops), away, strict=True)]
    )
    return [
        i & ~grown(np.any(np.abs(h) > limits[:, None, None], axis=0), 2 * kernels.KERNEL_REACH + 1) for h, i in every
    ]


def _without_bottom(high: Sequence[Float64], inside: Sequence[Mask], references: int) -> list[Mask]:
    """Masks `inside` without water where the NIR does not explain the bands (`UNLIKE`), because it shows the bottom.

    high : for each tile (plane, row, column), minus local means: references (their number is `references`), bands
    """
    total, left = partial(box_sum, side=LOCAL_MEAN), []
    for planes, mask in zip(high, inside, strict=True):
        nir, bands = np.where(mask, planes[0], 0), np.where(mask, planes[references:], 0)
        power = np.maximum(total(nir * nir), np.finfo(np.float64).tiny)
        rest = [(1 + 1e-9) * total(b * b) - total(b * nir) ** 2 / power for b in bands]  # 1e-9: not below 0 by rounding
        left.append(np.stack(rest) / np.maximum(total(mask.astype(np.float64)), 1))
    sample = np.concatenate([v[:, i] for v, i in zip(left, inside, strict=True)], axis=1)
    limits = UNLIKE * np.percentile(sample, QUARTILE, axis=1)[:, None, None]
    return [i & (v <= limits).all(axis=0) for v, i in zip(left, inside, strict=True)]


def _model(request: FitRequest, fitted: Sequence[Sequence[KernelFit]], common: CommonGlint) -> GlintModel:
    """Make a model, with levels 0, from kernels `fitted` for each kind of strip and the new responses in `common`."""
    whole = common.response + common.hidden  # change of a band if its NIR rises by 1 everywhere
    slopes = [float(s) if s > ROUNDING * whole.max() else 0.0 for s in whole]
    indexes = [_indexes(some, common, [s or 1.0 for s in slopes]) for some in fitted]
    fits = {}
    for f in fitted[0]:
        for place, loss in zip(f.bands, f.loss, strict=True):
            band, hidden = request.correct[place], float(common.hidden[place])
            error = float(np.hypot(np.sqrt(max(common.covariance[place, place], 0)), hidden))
            fits[place] = BandFit(band, request.names[band], place, slopes[place], error, float(1 - loss), f.pixels)
    second = indexes[1] if len(indexes) > 1 else ()
    return GlintModel("wiener", indexes[0], tuple(fits[p] for p in sorted(fits)), request.names, second=second)


def _indexes(fitted: Sequence[KernelFit], common: CommonGlint, slopes: Sequence[float]) -> tuple[GlintIndex, ...]:
    """Glint index of each band: its kernel, changed from the response s to the new response s', divided by its slope.

    k' = k + k_g (s' - s), with k_g the kernel of the common glint: the sum of the kernels of all bands in the fit with
    the weights of `common`, scaled to the response 1. Glint that noise and delays hide is added evenly over the window.
    """
    out = {}
    for f in fitted:
        weights = common.weights[f.bands]
        strength = float(weights @ f.response)
        kernel = f.coefficients @ (weights / strength) if strength > 0 else f.coefficients.mean(axis=1)
        at = [(r, o) for r, side in zip(f.references, f.support, strict=False) for o in offsets(side)]
        even = np.array([(r == f.references[0]) / f.support[0] ** 2 for r, _ in at])
        shifted = f.coefficients + np.outer(kernel, common.response[f.bands] - f.response)
        shifted += np.outer(even, common.hidden[f.bands])
        bands, places = zip(*at, strict=True)
        for k, place in enumerate(f.bands):
            out[place] = GlintIndex(bands, tuple(float(c) / slopes[place] for c in shifted[:, k]), 0.0, places)
    return tuple(out[p] for p in range(len(slopes)))


def _level_sample(model: GlintModel, some: npt.NDArray[np.intp], cleaned: Sequence[_Cleaned], side: int) -> LevelSample:
    """`LevelSample` of the bands `some` (positions in `fits`). Its local means are over `side` x `side` pixels."""
    slopes = np.array([f.slope for f in model.fits])[some]
    parts: list[tuple[npt.NDArray[Any], ...]] = []
    for tile in (t for t in cleaned if t.sample.any()):
        found = np.stack(list(predictions(tile.references, model, tile.origin)))[some]
        together = np.tensordot(slopes, found, 1)
        mean = np.asarray(cv2.blur(together, (AVERAGED, AVERAGED)))
        binomial = np.asarray(cv2.GaussianBlur(together, (AVERAGED, AVERAGED), 0))  # weights 1 2 1
        bands = np.stack(tile.bands)[some]
        weight = np.maximum(box_sum(tile.sample.astype(np.float64), side), 1.0)
        excess = np.where(tile.sample, found - bands / slopes[:, None, None], 0.0)
        local = np.stack([box_sum(e, side) for e in excess]) / weight
        planes = (found, bands, mean, binomial, local, apart_from_sparkle(together, tile.sample))
        parts.append(tuple(p[..., tile.sample] for p in planes))
    return LevelSample(*(np.concatenate(p, axis=-1) for p in zip(*parts, strict=True)))


def _with_level(model: GlintModel, of_glint: Float64, cleaned: Sequence[_Cleaned], request: FitRequest) -> GlintModel:
    """Return the model with levels (see `shared_level`, also for `of_glint`), their error, `floors`, and a warning."""
    every = np.array([f.slope for f in model.fits])
    some = np.flatnonzero(every)  # bands without glint are not changed
    slopes, of_glint = every[some], of_glint[some]
    # errors of the kernels extend over resolved waves, so that only means of wider squares suppress them
    sample = _level_sample(model, some, cleaned, LOCAL_MEAN if request.resolved else kernels.SIDE)
    level, interval = shared_level(sample, slopes, of_glint, resolved=request.resolved)
    error = shared_level_error(sample, slopes, of_glint, resolved=request.resolved) if request.level_error else None
    waves = [request.bands[request.correct[k]].wavelength or 560.0 for k in some]
    green = min(range(len(some)), key=lambda k: abs(waves[k] - 560.0))
    above = np.maximum(sample.prediction[green] - level[green], 0)
    warnings = *model.warnings, *_sheet_warning(interval, float(np.median(sample.value[green] - slopes[green] * above)))
    least = {} if request.faint_glint else dict(zip(some.tolist(), floors(sample, slopes, level), strict=True))
    levels = dict(zip(some.tolist(), level.tolist(), strict=True))
    indexes = tuple(replace(i, level=levels.get(k, 0.0)) for k, i in enumerate(model.indexes))
    second = tuple(replace(i, level=levels.get(k, 0.0)) for k, i in enumerate(model.second))
    fits = tuple(replace(f, floor=least.get(k)) for k, f in enumerate(model.fits))  # no floors with a posterior mean
    model = replace(model, indexes=indexes, fits=fits, second=second, warnings=warnings)
    return replace(model, level_interval=interval, level_stderr=error)


def _sheet_warning(interval: tuple[float, float, float], green: float) -> tuple[str, ...]:
    """Warning, if any, of a sheet of glint (`SHEET`); `interval` is from `shared_level`, `green` the median result."""
    lowest, chosen, middle = interval
    warning = (
        f"the glint level is uncertain: the lowest NIR over water, {chosen:.4g}, is {chosen / max(green, 1e-9):.0%} "
        "of the green. Turbid water or haze may cause this; if uniform glint does, the glint-free NIR is between "
        f"{lowest:.4g} and {middle:.4g}, and much of this glint remains."
    )
    return (warning,) if chosen > max(SHEET * green, 0) else ()
