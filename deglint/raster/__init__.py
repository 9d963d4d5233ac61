"""Read and write raster files by windows, with their nodata, masks, scales and offsets.

Other modules get pixel values as floating-point numbers, with NaN where a pixel is not valid. `RasterInfo` has the
properties of a file (type, nodata, tags, compression). rasterio is imported when a file is opened, not before.
"""

from .convert import FlatField
from .info import RasterInfo
from .source import FileBands, RasterSource

__all__ = ["FileBands", "FlatField", "RasterInfo", "RasterSource"]
