"""The rasters beside the image: flags, classes of sun glint, amounts and standard errors.

The classes and amounts are those of CEOS Analysis Ready Data, Product Family Specification Aquatic Reflectance,
version 2.0.1 (2026), per-pixel metadata "Sun Glint" (2.9) and "Sky Glint" (2.10), https://ceos.org/ard. It asks
whether sun glint in a pixel is negligible, correctable (moderate) or uncorrectable (severe), and for the amounts of
both for each pixel and spectral band. Version 1.0 (2022) says "absent" in place of "negligible".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..raster.output import Layout
from ..scene import FloatArray

if TYPE_CHECKING:
    from .correct import Correction
    from .outputs import Outputs, PixelCounts

FLAGS = {
    1: "nodata: not valid, copied",
    2: "not water, or outside the mask: copied",
    4: "corrected",
    8: "negative after correction, in some band",
    16: "saturated before correction, in some band",
    32: "clipped to the output's integer range (less the number for nodata), in some band",
    64: "replaced: glint of one instant, in some band, by the water beside it",
    128: "protected: a target, which exceeds the water in a way that glint does not, and was restored",
}
"""Bits of the flag raster's first band."""
NODATA, NOT_WATER, CORRECTED, NEGATIVE, SATURATED, CLIPPED, REPLACED, PROTECTED = FLAGS
GLINT_CLASSES = {0: "not assessed", 1: "negligible", 2: "correctable (moderate)", 3: "uncorrectable (severe)"}
"""Values of its second band: sun glint in the pixel before the correction."""
NOT_ASSESSED, NEGLIGIBLE, CORRECTABLE, UNCORRECTABLE = GLINT_CLASSES
SPECIFICATION = "CEOS-ARD Aquatic Reflectance 2.0.1"


def glint_classes(
    amount: FloatArray, noise: npt.NDArray[np.floating[Any]], saturated: npt.NDArray[np.bool_], water: Any
) -> npt.NDArray[np.uint8]:
    """Class of sun glint of each pixel.

    The specification calls glint uncorrectable where a band is saturated, and gives no limit of negligible glint. Here
    it is one standard deviation of the band's noise, in every band: such glint adds no more variance than the noise.

    Parameters
    ----------
    amount : (band, row, column) ndarray
        Glint that was removed from the bands that may change; no band where none may [unit of the band].
    noise : (band,) ndarray
        Standard deviation of their noise [unit of the band].
    saturated : (row, column) ndarray of bool
        Where some band was saturated.
    water : (row, column) ndarray of bool
        Where pixels were to be corrected; True for everywhere.

    Returns
    -------
    (row, column) uint8 ndarray
        One of `GLINT_CLASSES`: not assessed where there is no water, or no band was corrected.
    """
    out = np.full(amount.shape[1:], NOT_ASSESSED, np.uint8)
    np.copyto(out, NEGLIGIBLE, where=np.isfinite(amount).any(axis=0))
    out[(np.abs(amount) > noise[:, None, None]).any(axis=0)] = CORRECTABLE
    np.copyto(out, UNCORRECTABLE, where=saturated)
    return np.where(water, out, np.uint8(NOT_ASSESSED))


def glint_numbers(work: Correction, tally: PixelCounts) -> dict[str, Any]:
    """What the sidecar says of the classes."""
    noise = {work.scene.names[b]: n for b, n in zip(work.changed, work.noise, strict=True)}
    pixels = dict(zip(GLINT_CLASSES.values(), tally.glint, strict=True))
    return {"specification": SPECIFICATION, "pixels": pixels, "negligible_up_to": noise}


def beside(work: Correction, targets: Outputs, sky: Mapping[str, Any] | None) -> dict[str, tuple[Path, Layout]]:
    """The rasters beside the image, by the fields of a tile's result: their names, and what they are like."""
    info, bands = work.layout.info, tuple(work.amount_bands)
    options: dict[str, Any] = {"options": targets.options, "scaled": False, "tile": work.layout.tile}
    found = {}
    if targets.flags:
        tags = {f"CLASS_{value}": meaning for value, meaning in GLINT_CLASSES.items()}
        own = replace(info, band_tags=({}, {"": {**tags, "SPECIFICATION": SPECIFICATION}}, *info.band_tags[2:]))
        options_of_codes = {"names": ("flags", "sun glint class"), "flags": FLAGS, **options}
        found["flags"] = targets.flags, Layout(own, (0, 1), "uint8", None, **options_of_codes)
    amounts = replace(info, band_tags=tuple(_with_sky(info.band_tags[b], b, work, sky) for b in range(info.count)))
    for path, what, said, kept in (
        (targets.amount, "amount", "sun glint in", amounts), (targets.stderr, "stderr", "standard error of", info),
    ):  # fmt: skip
        if path:
            names = tuple(f"{said} {work.scene.bands[b].name}" for b in bands)
            found[what] = path, Layout(kept, bands, "float32", float("nan"), names=names, **options)
    return found


def _with_sky(tags: Mapping[str, Any], band: int, work: Correction, sky: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """A band's tags, with its modelled sky glint where that is known."""
    value = sky and sky["reflectance"].get(work.scene.bands[band].name)
    if not value:
        return tags
    said = {"SKY_GLINT_REFLECTANCE": f"{value:.4g}", "SKY_GLINT": "modelled at the water surface, not removed"}
    return {**tags, "": {**tags.get("", {}), **said}}
