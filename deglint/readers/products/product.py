"""Metadata of a product and its bands, and their conversion to descriptions of rasters.

A `Product` holds plain values from metadata. `described` opens the headers of its files and adds band names, scale,
offset, nodata, unit and tags of the product to their descriptions. After that, products and single files are treated
alike, and an output has the same metadata.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ...raster import FlatField, RasterInfo
from ...raster.info import describe, open_dataset


@dataclass(frozen=True)
class ProductBand:
    """One band of a product; values that are not in the metadata are None."""

    path: str  # GDAL name of its file
    name: str  # as the provider calls it ("B08")
    number: int = 1  # 1-based band of the file
    wavelength: float | None = None  # centre [nm]
    width: float | None = None  # full width at half maximum [nm]
    scale: float = 1.0  # physical value = file value * scale + offset
    offset: float = 0.0
    unit: str | None = None  # of the physical value
    nodata: float | None = None  # file value that means "not valid"
    saturation: float | None = None  # file value from which on the detector is saturated
    footprint: str | None = None  # GDAL name of a raster of detector numbers
    flat: FlatField | None = None  # correction of vignette and row gradient, for a file of one band


@dataclass(frozen=True)
class Product:
    """A product, or a part of it, as its metadata describe it."""

    kind: str  # family and level, such as "Sentinel-2 L2A"
    name: str  # name that the provider gave the product, without a path
    bands: tuple[ProductBand, ...]  # bands of one file are adjacent, in its order
    sensor: str | None = None  # a name of a sensor preset
    tags: Mapping[str, str] = field(default_factory=dict)  # for the output: time of acquisition, angles
    notes: tuple[str, ...] = ()  # what was left out or could not be used, one line each
    texts: tuple[str, ...] = ()  # GDAL names of the metadata files that were read

    @property
    def files(self) -> dict[str, tuple[ProductBand, ...]]:
        """The bands of each file, by its GDAL name, in order."""
        found: dict[str, tuple[ProductBand, ...]] = {}
        for band in self.bands:
            found[band.path] = (*found.get(band.path, ()), band)
        return found


def described(product: Product) -> tuple[list[RasterInfo], list[str]]:
    """Describe the files of a product, and return notes; metadata and headers are read, no pixels."""
    infos = []
    notes = list(product.notes)
    for path, bands in product.files.items():
        with open_dataset(path) as dataset:
            info = describe(dataset, path, alpha_is_band=dataset.count == len(bands))
        if info.count != len(bands) and len(bands) > 1:
            notes.append(f"{path} has {info.count} bands, the metadata {len(bands)}: they are not used")
            infos.append(info)
            continue
        if own := scaled_by_itself(info):
            notes.append(f"{path}: {own}")
        infos.append(filled(info, bands, {**product.tags, "product": product.name}, product.sensor))
    return infos, notes


def scaled_by_itself(info: RasterInfo) -> str:
    """Text that says why the product's scale, offset and nodata are not used for a file; "" if they are used."""
    if any(np.dtype(t).kind == "f" for t in info.dtypes):
        return "floating-point numbers are taken as they are, without the product's scale and offset"
    if any(s != 1 for s in info.scales) or any(o != 0 for o in info.offsets):
        return "its own scale and offset are used, not the product's"
    return ""


def filled(info: RasterInfo, bands: tuple[ProductBand, ...], tags: Mapping[str, str], sensor: str | None) -> RasterInfo:
    """A copy of a file's description with names, scale, offset, nodata, unit and tags of its product.

    Scale, offset and nodata in the file take precedence. `sensor` is a name for the tag "sensor".
    """
    bands = bands[: info.count] + bands[-1:] * (info.count - len(bands))
    own = bool(scaled_by_itself(info))
    flat = bands[0].flat if info.count == 1 else None
    dataset_tags = ({"sensor": sensor} if sensor else {}) | dict(tags) | dict(info.tags.get("", {}))
    named = replace(
        info,
        descriptions=tuple(b.name for b in bands),
        tags={**info.tags, "": dataset_tags},
        band_tags=tuple(
            {**t, "": {**t.get("", {}), **_band_tags(b, scaled=not own)}}
            for t, b in zip(info.band_tags, bands, strict=True)
        ),
    )
    if own:
        return named
    return replace(
        named,
        dtypes=info.dtypes if flat is None else ("float32",),
        flat=flat,
        units=tuple(b.unit or u for u, b in zip(info.units, bands, strict=True)),
        scales=tuple(b.scale for b in bands),
        offsets=tuple(b.offset for b in bands),
        nodatas=tuple(b.nodata if n is None else n for n, b in zip(info.nodatas, bands, strict=True)),
    )


def _band_tags(band: ProductBand, *, scaled: bool) -> dict[str, str]:
    """Tags of a band for `deglint.readers.spectral`. `scaled`: the product's scale is used, so saturation is added."""
    full = band.saturation if scaled else None
    facts = {"wavelength_nm": band.wavelength, "fwhm_nm": band.width, "FULL_SCALE": full}
    return {k: f"{v:.10g}" for k, v in facts.items() if v is not None}
