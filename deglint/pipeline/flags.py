"""Additional output rasters: flags, classes of sun glint, amounts and standard errors; and the modelled sky glint.

The classes and amounts follow CEOS Analysis Ready Data, Product Family Specification Aquatic Reflectance, version
2.0.1 (2026), per-pixel metadata "Sun Glint" (2.9) and "Sky Glint" (2.10), https://ceos.org/ard. The specification asks
whether sun glint in a pixel is negligible, correctable (moderate) or uncorrectable (severe), and for the amounts of
sun glint and sky glint in each pixel and spectral band. Version 1.0 (2022) says "absent" in place of "negligible".

Sky glint is skylight reflected by the sea. A removal of sun glint cannot measure it, as it is nearly constant over a
scene: it is modelled, not removed.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..moments import Mask
from ..physics import sky
from ..physics.atmosphere import CLEAR_AIR, WAVELENGTH_RANGE, irradiance
from ..physics.glint import VIEW_LIMIT
from ..physics.slopes import WIND_RANGE
from ..raster.convert import holds
from ..raster.output import Layout
from ..readers.text import number
from ..scene import FloatArray, Scene
from .block import Block, Corrected
from .messages import log
from .outputs import Outputs, PixelCounts
from .overview import raster_of

FLAGS = {
    1: "nodata: not valid, copied",
    2: "not water, or outside the mask: copied",
    4: "corrected",
    8: "negative after correction, in some band",
    16: "saturated before correction, in some band",
    32: "clipped to the output's integer range (less the number for nodata), in some band",
    64: "replaced: glint, in some band, by the background, which is the water around",
    128: "protected: a target, which exceeds the water in a way that glint does not, and was restored",
}  # bits of the first band of the flag raster
NODATA, NOT_WATER, CORRECTED, NEGATIVE, SATURATED, CLIPPED, REPLACED, PROTECTED = FLAGS
GLINT_CLASSES = {0: "not assessed", 1: "negligible", 2: "correctable (moderate)", 3: "uncorrectable (severe)"}
"""Values of the second band of the flag raster: class of sun glint in the pixel before the correction."""
NOT_ASSESSED, NEGLIGIBLE, CORRECTABLE, UNCORRECTABLE = GLINT_CLASSES
MODELLED = "modelled at the water surface, not removed"
SPECIFICATION = "CEOS-ARD Aquatic Reflectance 2.0.1"
SkyGlint = dict[str, Any] | None  # what `sky_glint` returns
SKY_MODEL = "harrison-coombes"
"""Sky model for the reported sky glint: a clear sky, as for the irradiance; sun glint occurs under a clear sky."""
SKY_WINDS = (5.0, 1.0, 15.0)
"""Winds if the scene states none [m/s]: the first for the reported sky glint (as in simulations), all for its range."""
VISIBILITIES = (40.0, 15.0, 80.0)
"""Visibilities [km]: the first for the reported sky glint (as in plans), all (also haze, clear air) for its range."""
_ANGLE_TAGS = {
    "sun zenith angle": ("sun_zenith_deg", "sun_elevation"),
    "sun azimuth": ("sun_azimuth_deg", "sun_azimuth"),
    "view zenith angle": ("view_zenith_deg", "view_elevation"),
    "view azimuth": ("view_azimuth_deg", "view_azimuth"),
}
"""Two tags of a scene that can state each angle [degree]; an elevation is 90 degrees minus the zenith angle."""


def tile_flags(
    block: Block, done: Corrected, *, saturated: Mask, negative: Mask, clipped: Mask
) -> npt.NDArray[np.uint8]:
    """Flags of a corrected tile, (row, column): sums of bits of `FLAGS`. The keywords are masks (band, row, column)."""
    flags = np.full(block.tile.shape, NOT_WATER, np.uint8)
    flags[block.where] = CORRECTED if done.changes else 0
    if done.replaced is not None:
        flags[done.replaced.any(axis=0) & block.where] |= REPLACED
    if done.targets is not None:
        flags[done.targets & block.where] |= PROTECTED
    flags[~block.known] = NODATA
    for bit, masks in ((SATURATED, saturated), (NEGATIVE, negative), (CLIPPED, clipped)):
        flags |= np.where(masks.any(axis=0), np.uint8(bit), np.uint8(0))
    return flags


def counted(
    block: Block, done: Corrected, flags: npt.NDArray[np.uint8], classes: npt.NDArray[np.uint8] | None, **marked: Mask
) -> PixelCounts:
    """Count the pixels of a tile.

    `flags` (row, column) gives the numbers of nodata, not water, corrected and protected pixels; `classes` (row,
    column), unless it is None, gives the number of each class of sun glint. Changed, replaced and `marked` pixels are
    counted for each band; the keys of `marked` are fields of the result, its values are masks (band, row, column).
    """
    kinds = {"nodata": NODATA, "not_water": NOT_WATER, "corrected": CORRECTED, "protected": PROTECTED}
    counts: dict[str, Any] = {name: int(np.count_nonzero(flags & bit)) for name, bit in kinds.items()}
    if done.replaced is not None:
        marked["replaced"] = done.replaced
    for name, masks in marked.items():  # ten times faster than numpy with an axis
        counts[name] = np.array([np.count_nonzero(mask) for mask in masks], np.int64)
    counts["changed"] = np.zeros(len(block.raw), np.int64)
    for band, place in done.changes.items():
        counts["changed"][band] = np.count_nonzero(place & np.isfinite(done.physical[band]))
    if classes is not None:
        counts["glint"] = np.bincount(classes.ravel(), minlength=len(GLINT_CLASSES))
    return PixelCounts(total=block.tile.pixels, **counts)


def glint_classes(amount: FloatArray, noise: FloatArray, saturated: Mask, water: Mask) -> npt.NDArray[np.uint8]:
    """Class of sun glint of each pixel, one of `GLINT_CLASSES`, (row, column).

    The specification calls glint uncorrectable where a band is saturated, and gives no limit of negligible glint. Here
    the limit in every band is one standard deviation of its noise: such glint adds no more variance than noise does.
    `amount` (band, row, column) is the glint that was removed from the bands that may change, `noise` (band,) the
    standard deviation of their noise [unit of the band], `saturated` (row, column) True where a band is saturated.
    Pixels outside `water` (row, column) are "not assessed", and so are unsaturated pixels without a finite amount.
    """
    out = np.full(amount.shape[1:], NOT_ASSESSED, np.uint8)
    np.copyto(out, NEGLIGIBLE, where=np.isfinite(amount).any(axis=0))
    out[(np.abs(amount) > noise[:, None, None]).any(axis=0)] = CORRECTABLE
    np.copyto(out, UNCORRECTABLE, where=saturated)
    return np.where(water, out, np.uint8(NOT_ASSESSED))


def glint_numbers(counts: PixelCounts, noise: Mapping[str, float]) -> dict[str, object]:
    """Sidecar entries: number of pixels of each class of sun glint, and limit of negligible glint of each band.
    `noise` is the standard deviation of the noise of each band that may change, by its name [unit of the band].
    """
    pixels = dict(zip(GLINT_CLASSES.values(), np.broadcast_to(counts.glint, len(GLINT_CLASSES)), strict=True))
    return {"specification": SPECIFICATION, "pixels": pixels, "negligible_up_to": noise}


def image_layout(scene: Scene, dtype: str | None, options: Mapping[str, str]) -> Layout:
    """Layout of the corrected image; its type is `dtype`, by default the scene's. `options`: GDAL creation options.

    The image has the nodata value of the first input band that has one. If the type of the image cannot hold this
    value, a float image gets NaN as nodata, and an integer image gets a mask. The image also gets a mask if the input
    has one, or if floats without nodata become integers.
    """
    source, bands = raster_of(scene), tuple(range(len(scene.bands)))
    info, out = source.info, np.dtype(dtype or source.info.dtype)
    nodata = next((n for n in info.nodatas if n is not None), None)
    masked = any(f.masked or f.alpha is not None for f in source.files)
    if out.kind == "f":
        if nodata is not None and np.isfinite(nodata) and abs(nodata) > float(np.finfo(out).max):
            nodata = float("nan")
    elif nodata is None or not holds(out, nodata):
        masked = masked or nodata is not None or info.dtype.kind == "f"
        nodata = None
    # a band without a description is named after its file, and must have this name in the output, too
    names = tuple(info.descriptions[b] or scene.bands[b].name for b in bands)
    return Layout(info, bands, out.name, nodata, options, names=names, masked=masked)


def beside(
    scene: Scene, image: Layout, bands: tuple[int, ...], targets: Outputs, modelled: SkyGlint
) -> dict[str, tuple[Path, Layout]]:
    """Path and layout of each additional raster (flags, amounts, standard errors); keys are fields of `CorrectedTile`.

    image : layout of the corrected image
    bands : 0-based bands of the amounts and the standard errors
    modelled : result of `sky_glint`
    """
    info, names, found = image.info, [scene.names[b] for b in bands], {}
    values = Layout(info, bands, "float32", float("nan"), targets.options, scaled=False, tile=image.tile)
    if targets.flags:
        tags = {f"CLASS_{value}": meaning for value, meaning in GLINT_CLASSES.items()}
        own = replace(info, band_tags=({}, {"": {**tags, "SPECIFICATION": SPECIFICATION}}, *info.band_tags[2:]))
        bits = replace(values, info=own, bands=(0, 1), dtype="uint8", nodata=None, flags=FLAGS)
        found["flags"] = targets.flags, replace(bits, names=("flags", "sun glint class"))
    if targets.amount:
        tags_of = list(info.band_tags)
        for i, band in enumerate(scene.bands):
            if value := modelled and modelled["reflectance"].get(band.name):
                sky_tags = {"SKY_GLINT_REFLECTANCE": f"{value:.4g}", "SKY_GLINT": MODELLED}
                tags_of[i] = {**tags_of[i], "": {**tags_of[i].get("", {}), **sky_tags}}
        kept = replace(values, info=replace(info, band_tags=tuple(tags_of)))
        found["amount"] = targets.amount, replace(kept, names=tuple(f"sun glint in {name}" for name in names))
    if targets.stderr:
        found["stderr"] = targets.stderr, replace(values, names=tuple(f"standard error of {name}" for name in names))
    return found


def sky_glint(scene: Scene) -> SkyGlint:
    r"""Sky-glint reflectance at the water surface for each band, constant over the scene.

    .. math:: \rho = \pi L / (E_{sun} + E_{sky})

    L is the reflected sky radiance; E_sun and E_sky are the irradiances by sun and sky (Gregg and Carder 1990).
    L / E_sky is from `physics.sky.reflectance`. The result is a dictionary: `reflectance` [1] of each band of 300 to
    1000 nm by name; `range`, its lowest and highest value over three sky models, `VISIBILITIES` and, if the scene
    states no usable wind, `SKY_WINDS`; and the assumptions. If the scene does not state the angles of sun and sensor,
    or has no such band, the result is None, and a line is logged.
    """
    tags = {k.casefold(): v for part in raster_of(scene).info.tags.values() for k, v in part.items()}
    angles = {k: a for k, names in _ANGLE_TAGS.items() if (a := _angle(tags, *names, zenith="zenith" in k)) is not None}
    low, high = WAVELENGTH_RANGE
    known = {b.name: b.wavelength for b in scene.bands if b.wavelength and low <= b.wavelength <= high}
    missing = [name for name in _ANGLE_TAGS if name not in angles]
    missing += [] if known else [f"a wavelength of {low:g} to {high:g} nm"]
    if missing:
        log.info("sky glint: not modelled, the scene does not state: %s", ", ".join(missing))
        return None
    wind, blows_from = number(tags.get("wind_m_s")) or 0.0, number(tags.get("wind_from_deg")) or 0.0
    winds = (wind,) if WIND_RANGE[0] <= wind <= max(SKY_WINDS) else SKY_WINDS
    sun, sun_azimuth, view, view_azimuth = angles.values()
    place = view, view_azimuth, sun, sun_azimuth
    mirrored = {
        model: np.pi * sky.reflectance(*place, wind=winds, wind_from=blows_from, model=model)
        for model in sky.SKY_MODELS
    }
    air = replace(CLEAR_AIR, wind=winds[0], wind_mean=winds[0])
    light = [irradiance(list(known.values()), sun, air, visibility=v) for v in VISIBILITIES]
    share = np.array([x.diffuse / (x.diffuse + x.direct) for x in light])
    every = np.multiply.outer(np.array(list(mirrored.values())).ravel(), share)
    value = dict(zip(known, map(float, mirrored[SKY_MODEL][0] * share[0]), strict=True))
    said = ", ".join(f"{name} {v:.4f}" for name, v in value.items())
    log.info("sky glint: modelled, not removed; reflectance at the surface %s", said)
    return {
        "reflectance": value,
        "range": dict(zip(known, np.stack([every.min(axis=(0, 1)), every.max(axis=(0, 1))], axis=1), strict=True)),
        "removed": False,
        "angles": angles,
        "wind": winds[0],
        "wind_stated": winds is not SKY_WINDS,
        "visibility": VISIBILITIES[0],
        "sky": SKY_MODEL,
    }


def _angle(tags: Mapping[str, str], name: str, other: str, *, zenith: bool) -> float | None:
    """Read an azimuth or zenith angle [degree] from tag `name`; if this has no number, from tag `other`.
    For a zenith angle (`zenith` is True), tag `other` has the elevation; 90 degrees minus the elevation is returned.
    Returns None if neither tag has a number, or a zenith angle is outside 0 to `VIEW_LIMIT`.
    """
    angle = number(tags.get(name))
    if angle is None and (angle := number(tags.get(other))) is not None and zenith:
        angle = 90.0 - angle
    return None if angle is None or (zenith and not 0.0 <= angle <= VIEW_LIMIT) else angle
