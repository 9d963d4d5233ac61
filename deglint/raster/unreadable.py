"""Why a file cannot be opened as a raster: what it is instead, as its first bytes say, and what to do."""

from __future__ import annotations

import re
from pathlib import Path

_HEAD = 512
"""Bytes of a file that are looked at."""
_FILE_KINDS = (
    (rb"\s*(?:<!doctype html|<html)", "is a web page. Log in where the image lies, and download the file again"),
    (rb"version https://git-lfs", "is a pointer of Git LFS, not the image itself. Fetch it: git lfs pull"),
    (rb"ENVI\s", "is the header of an ENVI file. Name the image beside it"),
    (rb"PK\x03\x04", "is a zip archive. Unpack it, or name the raster in it: /vsizip/{path}/NAME"),
    (rb"\x1f\x8b", "is packed with gzip. Unpack it, or name it /vsigzip/{path}"),
    (rb"Rar!|7z\xbc\xaf", "is an archive. Unpack it, and name the raster in it"),
    (rb"\x93NUMPY", "is a NumPy array. Write it as a GeoTIFF first"),
    (rb"%PDF", "is a PDF without an image that GDAL reads. Name the image itself"),
    (rb"\x89HDF|CDF[\x01\x02\x05]", "is HDF5 or NetCDF of a kind that GDAL here lacks. Convert it elsewhere"),
    (rb"\x00\x00\x00\x0cjP  |\xff\x4f\xff\x51", "is JPEG 2000, and damaged or of a kind that this GDAL lacks"),
    (rb"II[*+]\x00|MM\x00[*+]", "begins as a TIFF and is damaged. Copy or download it again"),
)  # fmt: skip


def what_instead(path: str) -> str:
    """What a local file that GDAL does not know is, and what to do: "it is ...".

    Its ending is not believed: files are often called what they are not.
    """
    place = Path(path)
    try:
        if place.is_dir():
            return "is a folder, and no product that is known. Name the raster files in it"
        with place.open("rb") as file:
            head = file.read(_HEAD)
    except PermissionError:
        return f"may not be read by you. Ask for the permission (chmod u+r {path}), or copy it"
    except (OSError, ValueError):
        return "is of no format that is known. Convert it to GeoTIFF, or name the raster itself"
    if not head:
        return "is empty: copying or downloading it has failed. Do that again"
    if not head.strip(b"\0"):
        return "holds zeros where its header should be: copying or downloading it has failed. Do that again"
    for pattern, said in _FILE_KINDS:
        if re.match(pattern, head, re.IGNORECASE):
            return said.format(path=path)
    text = not re.search(rb"[^\t\n\r\x20-\x7e\x80-\xff]", head)
    what = "is a text file" if text else "is of no format that is known"
    return f"{what}. Name the raster itself, or convert it to GeoTIFF where it can be read"


def lacks_support(said: str) -> bool:
    """Whether GDAL says that a file is whole, but needs what this GDAL was built without."""
    return bool(re.search(r"codec|not supported|unsupported|plugin|not available|no driver", said, re.IGNORECASE))
