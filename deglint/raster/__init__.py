"""Raster files: reading and writing of windows, nodata, masks, scale and offset.

Other modules get pixels as floating point, with NaN where they are not valid. The properties of a file (type, nodata,
tags, compression) are in `RasterInfo`. rasterio is imported when a file is opened, not before.
"""

from .convert import FlatField
from .info import RasterInfo
from .source import FileBands, RasterSource

__all__ = ["FileBands", "FlatField", "RasterInfo", "RasterSource"]
