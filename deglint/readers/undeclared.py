"""Find a nodata value, an offset and the NIR band that a file does not declare, from a sample of its pixels.

Opening a scene reads no pixels; `settled` is called later, before the scene is examined, fitted or corrected.
"""

import logging
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .. import tiles as tiling
from ..moments import Float64, Mask
from ..morphology import grown, opened
from ..raster.convert import Nodatas, Raw
from ..raster.info import RasterInfo
from ..raster.source import RasterSource
from ..scene import Scene
from ..tiles import Tile
from .bands import dialect, labelled
from .products.landsat import FACTORS
from .roles import VISIBLE
from .spectral import band_code, nominal_wavelength

log = logging.getLogger("deglint")
PIXELS_READ = 400_000  # pixels of a scene that are read; smaller scenes are read completely
SAMPLED_SIDE = 128  # side of the tiles that are read [pixel]
LEAST_SHARE, LEAST_OF_NOTHING = 0.02, 0.001
"""A value that is equal in all bands is nodata if its areas fill at least this share of the pixels. The second share
is for values of 0 and below, which no sensor measures in all bands."""
ALONE = 0.99
"""The value is nodata of a band if at least this share of the band's pixels with this value have it in all bands, too.
A band may be 0 in many pixels of dark water, where other bands are not."""
SOLID = 8  # inside the image, nodata fills squares of this side [pixel]; saturated sparkle does not
OF_DARKEST, DARK_INFRARED, LEAST, CLOUDS = (-0.005, 0.015), 0.03, -0.05, 1.5
"""Reflectances, if file values include an offset. Percentile 99 of no band exceeds `CLOUDS` (as if 65535 meant 1). The
minimum (percentile 0.1) of the darkest band lies in the first range, and that of no NIR or SWIR band exceeds the second
value, as water and shadow reflect almost nothing there. If an atmospheric correction has subtracted too much, a visible
band is the darkest, and below the range: glint, haze and water without an offset do not cause this. Below `LEAST` it
may be dark land beside bright water; with a NIR or SWIR band below `LEAST`, the offset is not included."""
ORDER = ("blue", "green", "red", "nir")
"""Usual order of four bands without names; red and blue may be exchanged. It is assumed if the last band is the darkest
(percentile `DARK`), as over water, or if its range (`DARK` to `UPPER`) is `WIDER` times the others, as over plants."""
DARK, UPPER, WIDER = 5.0, 95.0, 1.25

Offset = tuple[str, int, float, str]
"""Preset of a sensor, file value of reflectance 0, reflectance per file value, and name of products with the offset."""
OFFSETS: tuple[Offset, ...] = (
    ("sentinel2", 1000, 1e-4, "Sentinel-2 products since 2022"),  # from baseline 04.00 on (2022-01-25)
    *(
        (sensor, round(-FACTORS[level][1] / FACTORS[level][0]), FACTORS[level][0], f"Landsat Level-{level} products")
        for sensor, level in (("landsat8", "2"), ("landsat7", "2"), ("landsat8", "1"))
    ),
)
TileValues = tuple[Tile, Raw, Mask | None]
"""A tile, its file values (band, row, column), and the mask of valid values, or None if all are valid."""


@dataclass(frozen=True)
class Undeclared:
    """Undeclared properties that were found: one value per band (empty: none found), and one note per finding."""

    nodatas: tuple[float | None, ...] = ()
    offsets: tuple[float, ...] = ()
    wavelengths: tuple[float, ...] = ()  # [nm]
    notes: tuple[str, ...] = ()

    def on(self, scene: Scene) -> Scene:
        """A copy of `scene` with the findings added, as if the file declared them; `scene` itself if there are none."""
        if not self.notes or not isinstance(scene.source, RasterSource):
            return scene
        old, notes = scene.source.info, (*scene.notes, *(n for n in self.notes if n not in scene.notes))
        info = replace(old, nodatas=self.nodatas or old.nodatas, offsets=self.offsets or old.offsets)
        waves = self.wavelengths or [b.wavelength for b in scene.bands]
        bands = tuple(replace(b, wavelength=w) for b, w in zip(scene.bands, waves, strict=True))
        source = scene.source.declared(labelled(info, bands) if self.wavelengths else info)
        source.undeclared = self
        return replace(scene, source=source, bands=bands, notes=notes)


def settled(scene: Scene) -> Scene:
    """A copy of `scene` with the findings of `undeclared` added, as if the file declared them (see `Undeclared.on`)."""
    return undeclared(scene).on(scene)


def undeclared(scene: Scene) -> Undeclared:
    """Find undeclared nodata, an undeclared offset (`OFFSETS`), and the wavelengths of four bands without names.

    With several bands, nodata is searched for if neither file nor caller declares it. It is an unsaturated value that
    all bands have in areas that reach the image edge or contain a square of `SOLID` x `SOLID` pixels. These areas have
    at least 2 % of the pixels (0.1 % for values of 0 and below). Findings are logged, and kept for later calls.
    """
    source = scene.source
    if not isinstance(source, RasterSource):
        return Undeclared()
    if isinstance(source.undeclared, Undeclared):
        return source.undeclared
    info, found = source.info, Undeclared()
    # an added alpha only shows how far a resampled file reaches
    masked = any(f.masked or (f.alpha is not None and not (f.warp or {}).get("add_alpha")) for f in source.files)
    silent = not info.nodata_given and all(n is None for n in info.nodatas) and not masked
    cut, four = _cut_products(scene, info), _four(scene)
    if silent or cut or four:
        blocks: list[TileValues] = [(t, *source.read_raw(t.window)) for t in _tiles(scene)]
        if silent and info.count > 1:
            each = (_nodata(value, blocks, scene, info) for value in _commonest(blocks))
            found = next((f for f in each if f.notes), found)
        if cut:
            found = _offset(scene, info, blocks, found, cut)
        if four:
            found = _order(scene, info, blocks, found)
    source.undeclared = found
    for note in found.notes:
        log.warning("%s", note)
    return found


def _tiles(scene: Scene) -> list[Tile]:
    """Tiles to read: all tiles of a small scene, or a regular grid of tiles from edge to edge of a larger one."""
    side, size = SAMPLED_SIDE, (scene.height, scene.width)
    if scene.height * scene.width <= PIXELS_READ:
        return tiling.tiles(*size, (side, side))
    wanted = PIXELS_READ / side**2
    down = min(max(round(math.sqrt(wanted * scene.height / scene.width)), 3), -(-scene.height // side))
    across = min(max(round(wanted / down), 3), -(-scene.width // side))
    rows, columns = (
        np.linspace(0, max(n - side, 0), count).astype(int) for n, count in zip(size, (down, across), strict=True)
    )
    whole = Tile(0, scene.height, 0, scene.width)
    return [Tile(r, r + side, c, c + side).clipped(whole) for r in rows.tolist() for c in columns.tolist()]


def _nodata(value: float, blocks: list[TileValues], scene: Scene, info: RasterInfo) -> Undeclared:
    """Return `value` as nodata of the bands, or no finding if areas where all bands have it are small or saturated.

    A band with `value` in many pixels where others differ gets no nodata.
    """
    total = fill = areas = 0
    single, beside = np.zeros(info.count), []
    for tile, raw, valid in blocks:
        here = (raw == value).all(axis=0)
        rim = grown(here, 3) & ~here  # where resampled bands have mixed values
        total, fill = total + here.size, fill + int(here.sum())
        single += ((raw == value) & ~rim & (True if valid is None else valid)).sum(axis=(1, 2))
        areas += int((opened(here, SOLID) | _at_edge(scene, tile, here)).sum())
        beside.append(raw[:, rim].mean(axis=0, dtype=float))
    nodatas = tuple(value if fill >= ALONE * count else None for count in single)
    least = LEAST_SHARE if value > 0 else LEAST_OF_NOTHING
    if not least * total <= areas < total or all(n is None for n in nodatas):
        return Undeclared()
    around = np.concatenate(beside)
    if value > 0 and around.size and np.median(around) > value / 2:
        return Undeclared()  # saturated: around glint, boats and clouds values decrease gradually
    if value > 1 and info.dtype.kind in "iu" and value < np.iinfo(info.dtype).max and math.log2(value + 1) % 1 == 0:
        return Undeclared()  # 2^n - 1, the largest value of a sensor with fewer bits than the type
    note = (
        f"{value:g} in all bands, {fill / total:.1%} of the pixels, is taken for nodata and left out; "
        "if these are data, pass --nodata none"
    )
    return Undeclared(nodatas, notes=(note,))


def _commonest(blocks: list[TileValues]) -> list[float]:
    """Most frequent value up to 0, and most frequent value above 0, among pixels with the same value in all bands."""
    counts: Counter[float] = Counter()
    for _tile, raw, _valid in blocks:
        values, many = np.unique(raw[0][(raw == raw[0]).all(axis=0)], return_counts=True)
        counts.update({float(values[i]): int(many[i]) for i in np.argsort(many)[-4:] if math.isfinite(values[i])})
    kinds = [v for v in counts if v <= 0], [v for v in counts if v > 0]
    return [max(values, key=counts.__getitem__) for values in kinds if values]


def _at_edge(scene: Scene, tile: Tile, mask: Mask) -> Mask:
    """Pixels of `mask` that are connected, within the tile, to the edge of the image."""
    from scipy.ndimage import binary_propagation

    (rows, columns), rim = tile.shape, np.ones_like(mask)
    rim[tile.row0 == 0 : rows - (tile.row1 == scene.height), tile.col0 == 0 : columns - (tile.col1 == scene.width)] = 0
    return np.asarray(binary_propagation(rim & mask, mask=mask))


def _cut_products(scene: Scene, info: RasterInfo) -> list[Offset]:
    """Offsets that file values may include, as sensor, band codes, integer type and scale are those of products."""
    names = [b.name for b in scene.bands if b.wavelength]  # no classes or masks
    coded = len(names) > 2 and all(map(band_code, names))
    if not coded or info.offset_given or any(info.offsets) or info.dtype.kind not in "iu":
        return []
    sensor = scene.sensor or getattr(dialect(names), "name", None)
    return [o for o in OFFSETS if o[0] == sensor and all(s in (1.0, o[2]) for s in info.scales)]


def _four(scene: Scene) -> bool:
    """Whether there are four bands, the last without name and wavelength, and no other is known to be above 700 nm."""
    waves = [b.wavelength for b in scene.bands]
    unnamed = len(waves) == 4 and waves[3] is None and scene.names[3] == "band 4"
    return unnamed and all(w is None or w < VISIBLE for w in waves[:3])


def _order(scene: Scene, info: RasterInfo, blocks: list[TileValues], found: Undeclared) -> Undeclared:
    """Return `found`, with wavelengths of the four bands if the values in `blocks` agree with the order `ORDER`."""
    nodatas = found.nodatas or info.nodatas
    dark, bright = _percentiles(blocks, nodatas, (DARK, UPPER)) * info.scales + info.offsets
    if not np.isfinite(dark).all():  # of a band without valid values
        return found
    if not (dark[3] < dark[:3].min() or (bright - dark)[3] > WIDER * (bright - dark)[:3].max()):
        return found
    known = [b.wavelength for b in scene.bands]
    orders = [ORDER, (*ORDER[2::-1], ORDER[3])]
    for names in orders if dark[0] >= dark[2] else orders[::-1]:
        waves = tuple(w or nominal_wavelength(name) or 0.0 for name, w in zip(names, known, strict=True))
        if None not in known[:3] or waves[0] < waves[1] < waves[2] or waves[0] > waves[1] > waves[2]:
            break
    else:
        return found  # both orders contradict the names of some bands
    unnamed = ",".join(name for name, wavelength in zip(names, known, strict=True) if wavelength is None)
    said = f"bands without names are taken for {unnamed}, from their order and brightness"
    return replace(found, wavelengths=waves, notes=(*found.notes, f"{said}; if they are not, pass --bands NAMES"))


def _offset(
    scene: Scene, info: RasterInfo, blocks: list[TileValues], found: Undeclared, known: Sequence[Offset]
) -> Undeclared:
    """Return `found` with the `known` offset that values in `blocks` show, or with a note if they may have it."""
    waves, nodatas = [b.wavelength or 0.0 for b in scene.bands], found.nodatas or info.nodatas
    ends = _percentiles(blocks, nodatas, (0.1, 99)).tolist()
    floors, tops = ([(v, w) for v, w in zip(values, waves, strict=True) if w] for values in ends)
    infrared = [value for value, wavelength in floors if wavelength > VISIBLE]
    (lowest, where), (highest, _) = min(floors), max(tops)
    for _sensor, zero, scale, products in known if infrared else ():
        most, least, dark, top = (scale * (v - zero) for v in (max(infrared), min(infrared), lowest, highest))
        excluded = most > DARK_INFRARED or least < LEAST or dark > OF_DARKEST[1] or top > CLOUDS
        held = dark >= (LEAST if where < VISIBLE else OF_DARKEST[0])
        if excluded or not (held or where < VISIBLE):
            continue
        said, remedy = ("hold", "they do not, pass --offset 0") if held else ("may hold", f"so, pass --offset {-zero}")
        note = f"no infrared band is darker than {min(infrared):.0f}: the numbers {said} the offset of {products} "
        note += f"(reflectance = {scale:g} (DN - {zero})); if {remedy}"
        offsets = tuple(-zero * s if w else 0.0 for s, w in zip(info.scales, waves, strict=True)) if held else ()
        return replace(found, offsets=offsets, notes=(*found.notes, note))
    return found


def _percentiles(blocks: list[TileValues], nodatas: Nodatas, percents: Sequence[float]) -> Float64:
    """Percentiles of valid file values in pixels where not all bands are 0, (percent, band); infinite if none."""
    out = np.full((len(percents), len(nodatas)), np.inf)
    for band, nodata in enumerate(nodatas):
        values = np.concatenate([raw[band][_kept(raw, valid, band, nodata)] for _, raw, valid in blocks])
        out[:, band] = np.percentile(values, percents) if values.size else np.inf
    return out


def _kept(raw: Raw, valid: Mask | None, band: int, nodata: float | None) -> Mask:
    kept: Mask = (raw != 0).any(axis=0) & np.isfinite(raw[band])
    if valid is not None:
        kept &= valid[band]
    return kept if nodata is None else kept & (raw[band] != nodata)
