"""What tests of several modules use and that is no fixture: places, arguments, recipes, small images and files."""

import re
from dataclasses import replace
from functools import cache
from itertools import zip_longest
from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from deglint import Recipe, Scene
from deglint.masks import Roles
from deglint.physics.presets import preset
from deglint.plan import Mission
from deglint.remove import SampleTile
from deglint.simulate import Setup, simulate, thesis_array

ROOT = Path(__file__).parents[1]
SHARED = ROOT.parent / "shared" / "data"
TABLES = ROOT.parent / "shared" / "tables"

NAMES = ("blue", "green", "red", "nir")
ROLES = Roles(blue=0, green=1, red=2, nir=3)
WATER = np.array([900.0, 700.0, 400.0, 100.0])[:, None, None]
PLACE = {"crs": "EPSG:32653", "transform": from_origin(400_000, 800_000, 10, 10)}
SENTINEL2 = ("B02", "B03", "B04", "B08")
NARROW = (480, 560, 640, 739, 760, 775, 750, 840)
DTYPES = ("uint8", "int16", "uint16", "uint32", "int32", "float32", "float64")

RUN = ("--method", "hedley", "--sample", "all", "--mask", "none")
HEDLEY = Recipe(method="hedley", sample="all", mask="none")
PLAIN = Recipe(method="hedley", sample="all", mask="none", compensate="off")
BAY = Mission(latitude=36.8, longitude=-122.0, time="2026-06-21T18:00Z", wind=7.0, wind_from=310.0, step=2.0)


def says(text, *phrases):
    """Whether phrases occur in a text, in this order."""
    return re.search(".*".join(map(re.escape, phrases)), text, re.DOTALL) is not None


def beside(*parts):
    """Marks a test that needs a folder or file of the shared scenes, which need not lie beside the project."""
    absent = pytest.mark.skipif(not SHARED.joinpath(*parts).exists(), reason="not beside the project")
    return lambda test: pytest.mark.shared(absent(test))


def table(name):
    """A shared table of published or independently computed numbers."""
    if not (TABLES / name).exists():
        pytest.skip(f"{name} does not lie beside the project")
    return np.genfromtxt(TABLES / name, delimiter=",", names=True, skip_header=1, dtype=None, encoding="utf-8")


def image_of(bands=5, rows=40, columns=50, seed=0, offset=3.0):
    """Normal pixels whose bands are correlated."""
    rng = np.random.default_rng(seed)
    return np.einsum("ij,jrc->irc", rng.normal(size=(bands, bands)), rng.normal(size=(bands, rows, columns))) + offset


def scene_of(*bands):
    """A scene of which no pixel is read."""
    return Scene(bands=tuple(bands), height=4, width=5, source=None, path="scene.tif")


def wavelengths(scene):
    return [b.wavelength for b in scene.bands]


def whole_tile(block):
    """An array as one tile whose every pixel is valid and in the sample."""
    every = np.ones(block.shape[1:], bool)
    return SampleTile(block, every, every)


def write_bare(path, array, *, names=None, mask=None, describe=None, tags=None, band_tags=None, known=None, **options):
    """Write an array (band, row, column) as a raster that states no more than is given; `known` are attributes."""
    array = np.asarray(array)
    count, height, width = array.shape
    profile = {"driver": "GTiff", "dtype": array.dtype.name, "count": count, "height": height, "width": width}
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True), rasterio.open(path, "w", **(profile | options)) as dataset:
        for i, name in enumerate((names or ())[:count], start=1):
            dataset.set_band_description(i, name or "")
        for name, value in (known or {}).items():
            setattr(dataset, name, value)
        dataset.write(array)
        if mask is not None:
            dataset.write_mask(mask)
        for i, own in enumerate(band_tags or (), start=1):
            dataset.update_tags(i, **own)
        if tags:
            dataset.update_tags(**tags)
        if describe:
            describe(dataset)
    return str(path)


def write_vrt(path, rows, columns, source, *, bands=(1, 2, 3, 4), names=(), dtype="UInt16", more=""):
    """Write a VRT of bands of another file, which lies beside it; `more` goes into each band."""
    inside = "".join(
        f'<VRTRasterBand dataType="{dtype}" band="{i}">{more}<Description>{name or ""}</Description><SimpleSource>'
        f'<SourceFilename relativeToVRT="1">{source}</SourceFilename><SourceBand>{band}</SourceBand></SimpleSource>'
        "</VRTRasterBand>" for i, (band, name) in enumerate(zip_longest(bands, names), start=1)
    )  # fmt: skip
    Path(path).write_text(f'<VRTDataset rasterXSize="{columns}" rasterYSize="{rows}">{inside}</VRTDataset>')
    return str(path)


def read_raster(path):
    """All bands of a raster as they stand."""
    with rasterio.open(path) as dataset:
        return dataset.read()


def at_wavelengths(*centres):
    """Tags of bands with these centres [nm]."""
    return [{"wavelength": centre, "wavelength_units": "nm"} for centre in centres]


@cache
def simulated_squares(side, wind, delay, sensor="thesis", **more):
    """A simulated sea whose bright squares lie under water."""
    objects = thesis_array((side, side), 0.25, sides=(16,))
    setup = Setup(sensor=preset(sensor).delayed(delay), size=(side, side), wind=wind, objects=objects, **more)
    return simulate(replace(setup, sky="cardioidal", patch=0.06))
