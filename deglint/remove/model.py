"""The linear model that all methods fit.

All methods compute a *glint index* g of each pixel - the NIR band, or a weighted sum of bands - and subtract from every
corrected band, with the value L_i, a multiple of the excess of g over its glint-free level g0:

    L'_i = L_i - b_i (g - g0)

L'_i is the result. Methods differ only in the index, in the slopes b_i and in the level g0, so that one class can
represent all of them. Most methods process each pixel alone. An index with offsets is a kernel over neighbouring
pixels: a tile then needs `GlintModel.halo` more pixels on every side. A model with kernels never makes a pixel brighter
(unless it is `signed`), or darker than `BandFit.floor`. The result is the same to the bit for any tiles.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np

from ..checks import from_plain
from ..errors import InputError
from ..moments import Float64
from ..scene import FloatArray
from .reference import ReferenceRule
from .strips import Strips

FORMAT = 1  # version of the JSON text of a model


@dataclass(frozen=True, slots=True)
class GlintIndex:
    """A glint index g, which is a weighted sum of bands, and its level g0, which is the value of g without glint."""

    bands: tuple[int, ...]  # 0-based bands of the index
    weights: tuple[float, ...]  # weight of each band
    level: float = 0.0  # g0 [unit of the index]
    offsets: tuple[tuple[int, int], ...] = ()  # (row, column) at which each band is read [pixel]; empty: (0, 0)

    def of(self, planes: FloatArray | Mapping[int, FloatArray]) -> Float64:
        """The weighted sum g, (row, column), from bands (row, column) in `planes`; offsets and level are not used."""
        total = self.weights[0] * planes[self.bands[0]].astype(np.float64)
        for band, weight in zip(self.bands[1:], self.weights[1:], strict=True):
            total += weight * planes[band].astype(np.float64)
        return total


@dataclass(frozen=True, slots=True)
class BandFit:
    """How one band is corrected: its glint index, and its slope (glint of the band over glint of the index)."""

    band: int  # 0-based
    name: str
    index: int  # position of the glint index in `GlintModel.indexes`
    slope: float  # b_i [unit of the band per unit of the index]
    stderr: float | None = None  # standard error of the slope; None if the method does not estimate it
    r2: float | None = None  # share of the band's variance in the sample that the index explains; None: unknown
    n: int = 0  # pixels of the sample that were fitted
    floor: float | None = None  # the removal makes no pixel darker than this [unit of the band]; None: no limit


@dataclass(frozen=True, slots=True)
class GlintModel:
    """A fitted removal as plain values, to print, to save, and to apply to this scene or another.

    Attributes
    ----------
    method : str
        Key of `deglint.remove.METHODS`.
    indexes : tuple of GlintIndex
        Glint indexes; `BandFit.index` is the position of an index in this tuple.
    fits : tuple of BandFit
        One for each corrected band; other bands are copied.
    band_names : tuple of str
        Names of all bands of the scene to which the model was fitted.
    regression : str or None
        Name of the estimator of the slopes; None if the method does not estimate slopes by regression.
    warnings : tuple of str
        Warnings about the fit.
    references : tuple of ReferenceRule
        How ships, surf and land in each reference are replaced before kernels are applied; empty without a kernel.
    level_interval : (float, float, float), optional
        Levels common to all bands [unit of the index]: the lowest that makes (almost) no pixel negative after removal;
        the chosen one; and the median of the predicted NIR. Only wiener sets it.
    level_stderr : float, optional
        Standard error of the chosen level [unit of the index]; None if it was not estimated.
    strips : Strips, optional
        Where detector strips of two kinds, with opposite band delays, are in the scene; None if there is one kind.
    second : tuple of GlintIndex
        Glint indexes for the second kind of strip, in the order of `indexes`; empty if `strips` is None.
    signed : bool
        True if kernels may also add light, where they predict less than the level (`deglint.remove.mixture`).
    """

    method: str
    indexes: tuple[GlintIndex, ...]
    fits: tuple[BandFit, ...]
    band_names: tuple[str, ...]
    regression: str | None = None
    warnings: tuple[str, ...] = ()
    references: tuple[ReferenceRule, ...] = ()
    level_interval: tuple[float, float, float] | None = None
    level_stderr: float | None = None
    strips: Strips | None = None
    second: tuple[GlintIndex, ...] = ()
    signed: bool = False

    @property
    def halo(self) -> int:
        """Number of pixels that are needed on every side of a tile to apply the model."""
        reach = max((abs(o) for i in (*self.indexes, *self.second) for at in i.offsets for o in at), default=0)
        return max((r.halo for r in self.references), default=0) + reach

    def __str__(self) -> str:
        lines = [f"{self.method}" + (f" ({self.regression} slopes)" if self.regression else "")]
        for fit in self.fits:
            index = self.indexes[fit.index]
            text = f"  {fit.name:<12} slope {fit.slope:.6g}"
            if fit.stderr is not None:
                text += f" +- {fit.stderr:.2g}"
            if fit.r2 is not None:
                text += f"  R2 {fit.r2:.3f}"
            lines.append(f"{text}  n {fit.n}  from {self._index_name(index)}, level {index.level:.4g}")
        return "\n".join(lines + [f"  warning: {w}" for w in self.warnings])

    def __repr__(self) -> str:
        names = ", ".join(f.name for f in self.fits) or "no band"
        references = ", ".join(self.band_names[b] for b in self.index_bands)
        return f"GlintModel({self.method}: {names} on {references})"

    def _index_name(self, index: GlintIndex) -> str:
        """Text that names the bands of an index, with the sizes of its kernels, or its weights if it is not a mean."""
        if index.offsets:
            sides = {b: math.isqrt(index.bands.count(b)) for b in dict.fromkeys(index.bands)}
            return " and ".join(f"{self.band_names[b]} ({n} x {n} pixels)" for b, n in sides.items())
        names = [self.band_names[b] for b in index.bands]
        if len(set(index.weights)) == 1 and abs(sum(index.weights) - 1) < 1e-12:
            return names[0] if len(names) == 1 else f"mean of {', '.join(names)}"
        return " ".join(f"{w:+.4g} {n}" for w, n in zip(index.weights, names, strict=True))

    def to_json(self) -> str:
        """The model as JSON text with the version of the format. `--save-model` writes it, and `from_json` reads it."""
        return json.dumps({"format": FORMAT, "kind": "deglint model", **asdict(self)}, indent=2)

    @classmethod
    def from_json(cls, text: str) -> GlintModel:
        """Make a model from the text that `to_json` returned. Raises InputError if it is no model of this format."""
        try:
            data = json.loads(text)
            if data["kind"] != "deglint model" or data["format"] != FORMAT:
                raise ValueError(f"its format is {data['format']!r}, this version reads {FORMAT}")
            return _checked(from_plain(cls, data))
        except (KeyError, TypeError, ValueError, OverflowError, AttributeError, RecursionError) as error:
            why = f"it has no entry {error}" if isinstance(error, KeyError) else error
            raise InputError(f"not a saved deglint model ({why}); make one with --save-model.") from error

    def for_bands(self, names: tuple[str, ...]) -> GlintModel:
        """The same model for a scene whose bands have these names, in any order, in upper or lower case.

        Raises InputError if the scene lacks bands that the model needs.
        """
        if names == self.band_names:
            return self
        place = {name.casefold(): i for i, name in enumerate(names)}
        used = sorted({*self.index_bands, *(f.band for f in self.fits)})
        missing = [self.band_names[b] for b in used if self.band_names[b].casefold() not in place]
        if missing:
            raise InputError(f"the model needs band(s) {', '.join(missing)}; the scene has {', '.join(names)}.")
        to = [place.get(name.casefold(), -1) for name in self.band_names]
        indexes, second = (
            tuple(replace(i, bands=tuple(to[b] for b in i.bands)) for i in some) for some in (self.indexes, self.second)
        )
        references = tuple(replace(r, band=to[r.band]) for r in self.references)
        fits = tuple(replace(f, band=to[f.band]) for f in self.fits)
        return replace(self, indexes=indexes, second=second, references=references, fits=fits, band_names=names)

    @property
    def index_bands(self) -> tuple[int, ...]:
        """0-based bands that the glint indexes use, in ascending order."""
        return tuple(sorted({b for i in (*self.indexes, *self.second) for b in i.bands}))


def _checked(model: GlintModel) -> GlintModel:
    """Return the model if its bands and indexes exist, lists agree in length and slopes are finite; else ValueError."""
    indexes, names = (*model.indexes, *model.second), range(len(model.band_names))
    bands = {*(b for i in indexes for b in i.bands), *(f.band for f in model.fits), *(r.band for r in model.references)}
    if not (
        any(i.bands for i in model.indexes)
        and bands <= set(names)
        and {f.index for f in model.fits} <= set(range(len(model.indexes)))
        and all(len(i.bands) == len(i.weights) == len(i.offsets or i.bands) for i in indexes)
        and len(model.second) in (0, len(model.indexes))
        and (model.strips is None or (model.second and len({len(row) for row in model.strips.rows}) == 1))
        and len({f.band for f in model.fits}) == len(model.fits)
        and np.isfinite([f.slope for f in model.fits]).all()
    ):
        raise ValueError("its bands, indexes, weights, offsets, slopes or strips do not agree")
    return model
