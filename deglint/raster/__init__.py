"""The rooms that open and write raster files: windows, nodata, masks, scale and offset.

Inside the project pixels are floating point with NaN where they are not valid; what a file is like
(type, nodata, tags, compression) is known only here, in `RasterInfo`. rasterio is imported when a file
is opened, not before.
"""

from .convert import FlatField
from .info import RasterInfo
from .source import FileBands, RasterSource

__all__ = ["FileBands", "FlatField", "RasterInfo", "RasterSource"]
