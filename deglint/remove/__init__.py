"""Removal of glint from arrays: one module per method.

`METHODS` is the table that the command line, the documentation, the benchmarks and the tests iterate over. To add a
method, write a module with `fit(request, stats) -> GlintModel` (and `plan(request) -> SamplePlan` if it needs
statistics of a sample), add an entry to `METHODS`, and add a test against a published or independent value.

This package does not deal with files, tiles, threads, water masks or logging.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ..checks import check_choice, checked_keywords, described
from ..errors import InputError
from ..moments import Mask
from ..morphology import squares
from ..scene import Band, FloatArray, image_bands
from . import goodman, hedley, hochberg, joyce, kutser, lyzenga, mixture, multiband, nir_subtraction, wiener
from .model import BandFit, GlintIndex, GlintModel
from .predict import apply
from .request import FitRequest, regression_plan
from .statistics import REGRESSIONS, SamplePlan, SampleStatistics, gather, merge
from .wiener import SAMPLE_SIDE, SampleTile

__all__ = [
    "METHODS", "NIR_USES", "REGRESSIONS", "BandFit", "FitRequest", "GlintIndex", "GlintModel", "Method", "SamplePlan",
    "SampleStatistics", "SampleTile", "apply", "fit", "fit_pointwise", "gather", "merge", "nir_request",
]  # fmt: skip


@dataclass(frozen=True)
class Method:
    """A method of glint removal: one entry of the table `METHODS`.

    `fit` takes a request (the bands to correct and their references) and the sample: a list of `SampleTile` if
    `neighbours` is True, else the statistics that `plan` requests, or None if `plan` is None. `fit` raises FitError if
    the sample allows no fit (for example, with too few pixels), and BandError if a band that it needs is missing.
    """

    summary: str  # one line for `--help` and the documentation
    fit: Callable[[FitRequest, Any], GlintModel]
    plan: Callable[[FitRequest], SamplePlan] | None = None  # which statistics to gather; None if `fit` takes none
    options: tuple[str, ...] = ()  # fields of `FitRequest` that it uses; a recipe refuses others
    neighbours: bool = False  # the method uses neighbouring pixels, so it is fitted to tiles
    after_opening: Callable[..., GlintModel] | None = None  # `fit` for opened images, if it differs; see `mixture.fit`


NIR_USES = ("mean", "best", "set")  # ways to use several NIR bands, see `nir_request`
_index_plan = partial(regression_plan, keep_index=True)
_SLOPES, _LEVEL = "regression", "floor_percentile"

METHODS: dict[str, Method] = {
    "wiener": Method(
        "local linear filter on NIR and SWIR, one glint-free level",
        wiener.fit,
        neighbours=True,
        after_opening=mixture.fit,
    ),
    "hedley": Method(
        "slope on the NIR, level at its minimum (Hedley 2005)", hedley.fit, regression_plan, (_SLOPES, _LEVEL)
    ),
    "lyzenga": Method("slope on the NIR, level at its mean (Lyzenga 2006)", lyzenga.fit, regression_plan, (_SLOPES,)),
    "joyce": Method("slope on the NIR, level at its mode (Joyce 2004)", joyce.fit, _index_plan, (_SLOPES,)),
    "multiband": Method("longer bands together, level at a low percentile", multiband.fit, multiband.plan, (_LEVEL,)),
    "hochberg": Method("slope from darkest to brightest NIR pixel (Hochberg 2003)", hochberg.fit, hochberg.plan),
    "goodman": Method("reflectance at 750 nm, floor from 640 nm (Goodman 2008)", goodman.fit, options=("rrs_factor",)),
    "kutser": Method("oxygen line at 760 nm, bands at 739, 760, 775 nm (Kutser 2009)", kutser.fit, kutser.plan),
    "nir-subtraction": Method("subtract the NIR reflectance itself (Dierssen 2003)", nir_subtraction.fit),
}


@checked_keywords("regression", "floor_percentile", "rrs_factor", "correct", "use")
def fit(
    method: str,
    block: FloatArray,
    *,
    nir: int | Sequence[int],
    sample: Mask | None = None,
    bands: Sequence[Band] | None = None,
    **options: Any,
) -> GlintModel:
    """Fit a method to an array in memory.

    Parameters
    ----------
    method : str
        Key of `METHODS`.
    block : (band, row, column) ndarray
        Physical values, NaN or masked where not valid.
    nir : int or sequence of int
        0-based NIR band or bands; the option `use` (see `nir_request`) says how several of them serve as reference.
    sample : (row, column) bool ndarray, optional
        True over deep water with glint; by default every valid pixel is used. All valid pixels count as water.
    bands : sequence of Band, optional
        Names and wavelengths; "band 1", "band 2", ... by default.
    **options
        regression, floor_percentile, rrs_factor: see `FitRequest`; use, correct: see `nir_request`. The default
        regression of wiener is "detrended", that of other methods "ols".

    Returns
    -------
    GlintModel
        The model has a warning and no `fits` if wiener finds no glint that is worth removing.

    Raises
    ------
    InputError
        If an argument is not valid, a band that the method needs is missing (BandError), or no band is left to correct.
    FitError
        If the sample does not allow a fit, for example because it has too few pixels.

    Examples
    --------
    >>> import numpy as np
    >>> nir = np.linspace(1, 2, 400).reshape(20, 20)
    >>> model = fit("hedley", np.stack([5 + 0.5 * nir, nir]), nir=1)
    >>> round(model.fits[0].slope, 6), model.indexes[0].level
    (0.5, 1.0)
    """
    check_choice(method, list(METHODS), "method")
    block, mask = _checked(block, sample)
    known = tuple(bands) if bands else tuple(Band(f"band {i + 1}") for i in range(len(block)))
    if len(known) != len(block):
        raise InputError(f"bands: want one for each of the {len(block)} bands of the array, got {len(known)}.")
    if not METHODS[method].neighbours:
        return fit_pointwise(method, nir_request(known, nir, **options), [block], [mask])
    request = nir_request(known, nir, **{"regression": "detrended", **options})
    places = squares(mask.shape, SAMPLE_SIDE)
    tiles = [SampleTile(block[:, r, c], np.ones_like(mask[r, c]), mask[r, c], (r.start, c.start)) for r, c in places]
    return METHODS[method].fit(request, tiles)


def _checked(block: FloatArray, sample: Mask | None) -> tuple[FloatArray, Mask]:
    """Return `block` as floats, NaN where masked, and `sample` (all True if None); InputError if shapes are wrong."""
    block = np.asanyarray(block)
    if block.ndim != 3 or not block.size:
        raise InputError(f"expected a (band, row, column) array with pixels, got shape {block.shape}.")
    block = np.ma.filled(block.astype(np.result_type(block.dtype, np.float32), copy=False), np.nan)
    mask = np.ones(block.shape[1:], np.bool_) if sample is None else np.asarray(np.ma.filled(sample, False), np.bool_)
    if mask.shape != block.shape[1:]:
        raise InputError(f"sample has shape {mask.shape}, but the block has {block.shape[1:]} pixels.")
    return block, mask


def fit_pointwise(method: str, request: FitRequest, blocks: Sequence[FloatArray], masks: Sequence[Mask]) -> GlintModel:
    """Fit a method without kernels to tiles: `blocks`, (band, row, column), and masks of the sample, (row, column)."""
    chosen = METHODS[method]
    if chosen.plan is None:
        return chosen.fit(request, None)
    plan = chosen.plan(request)
    parts = [gather(block[list(plan.read_bands)], mask, plan) for block, mask in zip(blocks, masks, strict=True)]
    return chosen.fit(request, merge(parts, plan))


def nir_request(
    bands: Sequence[Band],
    nir: int | Sequence[int],
    *,
    use: str = "mean",
    correct: Sequence[int] | None = None,
    **options: Any,
) -> FitRequest:
    """Make the request for a fit from all bands of the scene and the NIR bands, `nir` (0-based).

    use : reference of a band if there are several NIR bands: "mean", their mean; "best", the NIR band that explains the
        band best; "set", the first NIR band of the same group (`Band.group`: bands taken at the same time). The method
        wiener uses the first NIR band instead of "mean" and "best"
    correct : 0-based bands to correct. By default these are the bands of shorter wavelength than the longest NIR band,
        or all bands if none except the NIR has a wavelength. Other bands, and always the NIR bands, are copied
    options : regression, floor_percentile, rrs_factor: see `FitRequest`

    Raises InputError if a selection is not possible, or an option is out of range.
    """
    nir = _numbers(nir, len(bands), "nir")
    limit = max([w for b in nir if (w := bands[b].wavelength)], default=math.inf)
    shorter = [i for i in image_bands(bands, nir) if (bands[i].wavelength or 0.0) < limit]
    wanted = shorter if correct is None else _numbers(correct, len(bands), "correct")
    chosen = tuple(dict.fromkeys(b for b in wanted if b not in nir))
    check_choice(use, list(NIR_USES), "use of several NIR bands")
    if use == "mean":
        indexes = [GlintIndex(tuple(nir), (1.0 / len(nir),) * len(nir))]
        follows: list[int | None] = [0] * len(chosen)
    else:
        indexes = [GlintIndex((b,), (1.0,)) for b in nir]
        follows = [None if use == "best" else _same_group(bands, nir, b) for b in chosen]
    return FitRequest(tuple(bands), chosen, tuple(indexes), tuple(follows), **options)


def _numbers(value: int | Sequence[int], count: int, name: str) -> list[int]:
    """List of the bands in `value`; InputError (about `name`) if it is empty or a band is not in 0..`count` - 1."""
    found: list[int] = np.atleast_1d(value).tolist()
    if not all(isinstance(b, int) for b in found):
        raise InputError(f"{name}: want 0-based numbers of bands of the array, got {described(value)}.")
    if not all(0 <= b < count for b in found) or not found:
        raise InputError(f"{name}: band(s) {found} are not among the {count} bands (counted from 0).")
    return found


def _same_group(bands: Sequence[Band], nir: Sequence[int], band: int) -> int:
    """Position in `nir` of the first band with the same `Band.group` as `band`; raises InputError if there is none."""
    for k, reference in enumerate(nir):
        if bands[reference].group and bands[reference].group == bands[band].group:
            return k
    raise InputError(
        f"none of the NIR ({', '.join(bands[b].name for b in nir)}) is taken at the same time as {bands[band].name}: "
        "select a NIR of each set of bands (--nir NUMBER,NUMBER), or take --nir-use mean or best."
    )
