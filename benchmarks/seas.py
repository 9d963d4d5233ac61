"""Write a synthetic sea of any size with glint, for the measurement of times.

It has eight bands with the names and tags of WorldView-3, open water with a slow change of colour, swell, sparkle and
noise, and a coast along one edge. Errors are measured on the more realistic scenes of `deglint simulate`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import rasterio
from rasterio.transform import from_origin
from rasterio.windows import Window

Float32 = npt.NDArray[np.float32]

NAMES = ("COASTAL", "BLUE", "GREEN", "YELLOW", "RED", "REDEDGE", "NIR1", "NIR2")
WAVELENGTHS = (425, 480, 545, 605, 660, 725, 832, 950)
"""Centres of the bands [nm]."""
WATER = np.array([0.045, 0.040, 0.030, 0.018, 0.012, 0.008, 0.005, 0.004], np.float32)
LAND = np.array([0.05, 0.06, 0.09, 0.11, 0.13, 0.22, 0.30, 0.31], np.float32)
GLINT = np.array([1.00, 1.00, 0.99, 0.97, 0.96, 0.95, 0.94, 0.92], np.float32)
NOISE = 0.0004
SCALE = 1e-4
"""Reflectance of one count."""
WRITTEN_TILE = 512
COAST = 0.04
"""Share of the scene's width that is land."""


def tile(row: int, column: int, side: int, shape: tuple[int, int]) -> Float32:
    """Reflectance (band, row, column) of the tile of `shape` at (row, column), in a scene of side x side pixels."""
    rng = np.random.default_rng([20, side, row, column])
    y = np.arange(row, row + shape[0], dtype=np.float32)[:, None]
    x = np.arange(column, column + shape[1], dtype=np.float32)[None, :]
    swell = np.sin(0.21 * x + 0.08 * y) + 0.6 * np.sin(0.07 * x - 0.17 * y)
    sparkle = rng.standard_exponential(shape, np.float32)
    glint = np.float32(0.012) * np.exp(swell - 1) * sparkle
    colour = 1 + 0.15 * np.sin(2 * np.pi * y / side) * np.cos(2 * np.pi * x / side)
    out: Float32 = rng.standard_normal((len(NAMES), *shape), np.float32)
    out *= np.float32(NOISE)
    out += WATER[:, None, None] * colour + GLINT[:, None, None] * glint
    land = np.broadcast_to(x < COAST * side * (1 + 0.3 * np.sin(9 * y / side)), shape)
    out[:, land] = (LAND[:, None] * rng.uniform(0.8, 1.2, int(land.sum()))).astype(np.float32)
    return out


def write_sea(path: Path, side: int) -> None:
    """Write a scene of side x side pixels as uint16 counts."""
    profile = {
        "driver": "GTiff", "width": side, "height": side, "count": len(NAMES), "dtype": "uint16", "crs": "EPSG:32653",
        "transform": from_origin(450_000, 900_000, 2, 2), "tiled": True, "blockxsize": 512, "blockysize": 512,
        "interleave": "pixel", "BIGTIFF": "IF_SAFER", "compress": "deflate", "predictor": 2, "num_threads": "ALL_CPUS",
    }  # fmt: skip
    with rasterio.open(path, "w", **profile) as out:
        out.scales = [SCALE] * len(NAMES)
        for band, (name, wavelength) in enumerate(zip(NAMES, WAVELENGTHS, strict=True), start=1):
            out.set_band_description(band, name)
            out.update_tags(band, wavelength=f"{wavelength:g}", wavelength_units="nm")
        for row in range(0, side, WRITTEN_TILE):
            for column in range(0, side, WRITTEN_TILE):
                shape = min(WRITTEN_TILE, side - row), min(WRITTEN_TILE, side - column)
                counts = np.clip(np.rint(tile(row, column, side, shape) / SCALE), 0, 65535).astype(np.uint16)
                out.write(counts, window=Window(column, row, shape[1], shape[0]))
