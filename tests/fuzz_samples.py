"""Small valid files of every kind that the commands read, for `tests/fuzz.py` to change."""

from __future__ import annotations

import json
from pathlib import Path


def samples(directory: Path) -> dict[str, Path]:
    """Small valid files of every kind that the commands read, by name."""
    import numpy as np
    import rasterio
    from common import NAMES, PLACE, RUN, WATER
    from rasterio.enums import Resampling

    rng = np.random.default_rng(5)
    glint = rng.gamma(0.5, 120.0, (48, 64))
    sea = WATER + glint + rng.normal(0, 3, (4, 48, 64))
    shapes = {
        "plain.tif": {}, "deflate.tif": {"compress": "deflate", "predictor": 2},
        "lzw.tif": {"compress": "lzw", "tiled": True, "blockxsize": 16, "blockysize": 16, "interleave": "pixel"},
        "tiles.tif": {"tiled": True, "blockxsize": 32, "blockysize": 32},
        "zstd.tif": {"compress": "zstd", "dtype": "float32", "nodata": "nan"}, "big.tif": {"BIGTIFF": "YES"},
        "jpeg.tif": {"compress": "jpeg", "dtype": "uint8", "tiled": True, "blockxsize": 16, "blockysize": 16},
        "packbits.tif": {"compress": "packbits", "dtype": "uint8"}, "envi.img": {"driver": "ENVI"},
        "plain.png": {"driver": "PNG", "dtype": "uint8"},
    }  # fmt: skip
    found = {}
    for name, options in shapes.items():
        profile = {"driver": "GTiff", "dtype": "uint16", "count": 4, "height": 48, "width": 64}
        profile |= PLACE | options
        path = found[name] = directory / name
        with rasterio.open(path, "w", **profile) as out:
            out.write(np.clip(sea, 0, 255 if profile["dtype"] == "uint8" else 65535).astype(profile["dtype"]))
            for i, band in enumerate(NAMES, start=1):
                out.set_band_description(i, band)
    with rasterio.open(found["tiles.tif"], "r+") as out:
        out.build_overviews([2, 4, 8], Resampling.average)
    found["envi.hdr"] = directory / "envi.hdr"
    (directory / "raw.bin").write_bytes(bytes(range(256)) * 12)
    texts = {
        "mosaic.vrt": _vrt(), "nested.vrt": _vrt("mosaic.vrt"), "raw.vrt": _RAW, "warped.vrt": _WARPED,
        "area.geojson": json.dumps(_area()), "recipe.toml": _RECIPE, "mission.toml": _MISSION,
        "list.csv": "path,name\nplain.tif,a\nlzw.tif;big.tif,b\n",
        "stac.json": json.dumps({"type": "FeatureCollection", "features": [
            {"type": "Feature", "id": "a", "assets": {"data": {"href": "plain.tif", "type": "image/tiff"}}}]}),
    }  # fmt: skip
    for name, text in texts.items():
        found[name] = directory / name
        found[name].write_text(text)
    from deglint.cli import run
    from detect.cli import run as rxdetect

    found["model.json"], found["background.json"] = directory / "model.json", directory / "background.json"
    plain, model = str(found["plain.tif"]), str(found["model.json"])
    run(["remove", "-q", plain, str(directory / "o.tif"), *RUN, "--overwrite", "--save-model", model])
    rxdetect(["score", "-q", plain, str(directory / "scores.tif"), "--overwrite", "--save-background",
              str(found["background.json"])])  # fmt: skip
    found["scores.tif"] = directory / "scores.tif"
    return found


_RECIPE = """[recipe]
method = "hedley"
sample = "all"
mask = "none"
nir = ["4"]
floor_percentile = 1.5
[input]
nodata = 0
[output]
directory = "out"
name = "{name}_clean.tif"
extras = ["flags"]
dtype = "uint16"
options = {COMPRESS = "DEFLATE"}
"""


_MISSION = """[place]
latitude = 36.8
longitude = -122.0
time = "2026-06-21T18:00Z"
[wind]
speed = 7.0
from = 310.0
[object]
depth = 5.0
[look]
step = 10.0
"""
_RAW = """<VRTDataset rasterXSize="64" rasterYSize="48">
<VRTRasterBand dataType="Byte" band="1" subClass="VRTRawRasterBand">
<SourceFilename relativeToVRT="1">raw.bin</SourceFilename><ImageOffset>0</ImageOffset><PixelOffset>1</PixelOffset>
<LineOffset>64</LineOffset><ByteOrder>LSB</ByteOrder></VRTRasterBand></VRTDataset>"""
_WARPED = """<VRTDataset rasterXSize="64" rasterYSize="48" subClass="VRTWarpedDataset"><SRS>EPSG:32653</SRS>
<GeoTransform>400000, 10, 0, 800000, 0, -10</GeoTransform>
<VRTRasterBand dataType="UInt16" band="1" subClass="VRTWarpedRasterBand"/><BlockXSize>64</BlockXSize>
<BlockYSize>48</BlockYSize><GDALWarpOptions><WarpMemoryLimit>6.71e+07</WarpMemoryLimit>
<ResampleAlg>NearestNeighbour</ResampleAlg><WorkingDataType>UInt16</WorkingDataType>
<SourceDataset relativeToVRT="1">plain.tif</SourceDataset><Transformer><GenImgProjTransformer>
<SrcGeoTransform>400000,10,0,800000,0,-10</SrcGeoTransform>
<SrcInvGeoTransform>-40000,0.1,0,80000,0,-0.1</SrcInvGeoTransform>
<DstGeoTransform>400000,10,0,800000,0,-10</DstGeoTransform>
<DstInvGeoTransform>-40000,0.1,0,80000,0,-0.1</DstInvGeoTransform>
</GenImgProjTransformer></Transformer><BandList><BandMapping src="1" dst="1"/></BandList></GDALWarpOptions>
</VRTDataset>"""


def _vrt(source: str = "plain.tif") -> str:
    bands = "".join(
        f'<VRTRasterBand dataType="UInt16" band="{b}"><NoDataValue>0</NoDataValue><SimpleSource>'
        f'<SourceFilename relativeToVRT="1">{source}</SourceFilename><SourceBand>{b}</SourceBand>'
        '<SrcRect xOff="0" yOff="0" xSize="64" ySize="48"/><DstRect xOff="0" yOff="0" xSize="64" ySize="48"/>'
        "</SimpleSource></VRTRasterBand>" for b in (1, 2, 3, 4)
    )  # fmt: skip
    return f'<VRTDataset rasterXSize="64" rasterYSize="48"><SRS>EPSG:32653</SRS>{bands}</VRTDataset>'


def _area() -> dict[str, object]:
    ring = [[400_050, 799_900], [400_500, 799_900], [400_500, 799_600], [400_050, 799_600], [400_050, 799_900]]
    return {"type": "FeatureCollection", "crs": {"type": "name", "properties": {"name": "EPSG:32653"}},
            "features": [{"type": "Feature", "properties": {},
                          "geometry": {"type": "Polygon", "coordinates": [ring]}}]}  # fmt: skip
