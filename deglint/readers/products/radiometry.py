"""What the XMP of a capture says of its radiometry: exposure, gain and black level, vignette and row gradient.

References
----------
MicaSense, imageprocessing (micasense.utils.raw_image_to_radiance),
https://github.com/micasense/imageprocessing
DJI, Mavic 3M Image Processing Guide (2023), equation 9 and the vignetting correction.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ...raster import FlatField, RasterInfo
from .metadata import number, numbers, positive

Facts = Mapping[str, Sequence[str]]
_BLACK_LEVEL = 50714  # the tag of DNG, which GDAL does not tell of
_PLAUSIBLE = (0.1, 10.0)
"""By what light may be multiplied: lenses lose less than nine tenths in the corners."""


@dataclass(frozen=True)
class Radiometry:
    """physical = scale * (number in the file - black), the number being corrected by `flat`."""

    scale: float = 1.0
    black: float = 0.0
    unit: str | None = None
    flat: FlatField | None = None
    applied: tuple[str, ...] = ()  # what is corrected, in words; empty where the XMP says nothing of it
    notes: tuple[str, ...] = ()  # what is not, and why


def one(facts: Facts, name: str) -> str:
    """The first value of that name, or ""."""
    return next(iter(facts.get(name, ())), "")


def radiometry_of(info: RasterInfo, facts: Facts) -> Radiometry:
    """The radiometry of a capture of one band, as it left the camera; nothing of it where the XMP does not say."""
    if info.count != 1 or info.dtypes[0] != "uint16":
        return Radiometry()
    found = _micasense(info, facts) or _dji(facts) or Radiometry()
    if found.flat is None or _plausible(found.flat, info):
        return found
    note = f"{info.paths[0]}: the vignette or row gradient in its XMP is not plausible: neither is corrected"
    return replace(found, flat=None, applied=found.applied[:1], notes=(note,))


def _micasense(info: RasterInfo, facts: Facts) -> Radiometry | None:
    """L = V(x, y) R(y) (p - black) a1 / (gain t 2^16), R = 1 / (1 + (a2 / t - a3) y)."""
    exif = {k: number(v.strip("()")) for k, v in info.tags.get("EXIF", {}).items()}
    calibration, dark, centre, vignette = (
        [n for text in facts.get(name, ()) for n in numbers(text)]
        for name in ("RadiometricCalibration", "DarkRowValue", "VignettingCenter", "VignettingPolynomial")
    )
    shutter = exif.get("EXIF_ExposureTime")
    if not calibration or not shutter or shutter <= 0 or calibration[0] <= 0:
        return None
    gain = (exif.get("EXIF_ISOSpeed") or exif.get("EXIF_ISOSpeedRatings") or 100.0) / 100.0
    black = _black_level(info.paths[0])
    if black is None:
        black = sum(dark) / len(dark) if dark else 0.0
    has_vignette = len(centre) == 2 and bool(vignette)
    has_gradient = len(calibration) == 3
    flat = FlatField(
        black=black,
        centre=(centre[0], centre[1]) if has_vignette else (0.0, 0.0),
        polynomial=tuple(vignette) if has_vignette else (),
        row_gradient=calibration[1] / shutter - calibration[2] if has_gradient else 0.0,
    )
    words = ["exposure, gain and black level", *["vignette"] * has_vignette, *["row gradient"] * has_gradient]
    return Radiometry(calibration[0] / (gain * shutter * 65536), black, "W m-2 sr-1 nm-1",
                      flat if len(words) > 1 else None, tuple(words))  # fmt: skip


def _dji(facts: Facts) -> Radiometry | None:
    """(p - black) / 2^16 / (gain t), times the camera's factor: proportional to radiance, the unit is not known."""
    micro, gain = positive(one(facts, "ExposureTime")), positive(one(facts, "SensorGain"))
    black = number(one(facts, "BlackLevel") or one(facts, "BlackCurrent"))
    if micro is None or gain is None or black is None:
        return None
    factor = positive(one(facts, "SensorGainAdjustment")) or 1.0
    vignette = numbers(one(facts, "VignettingData"))
    centre = [number(one(facts, f"CalibratedOpticalCenter{axis}")) for axis in "XY"]
    flat, words = None, ["exposure, gain and black level"]
    if vignette and None not in centre and one(facts, "VignettingFlag") != "1":  # 1: the camera has done it
        flat = FlatField(black, (centre[0] or 0.0, centre[1] or 0.0), tuple(vignette), corrects=True)
        words.append("vignette")
    return Radiometry(factor / (65536 * gain * micro * 1e-6), black, None, flat, tuple(words))


def _plausible(flat: FlatField, info: RasterInfo) -> bool:
    """Whether the correction stays within bounds along the edges of the image and its middle row."""
    rows, columns = info.height, info.width
    lines = [((r, r + 1), (0, columns)) for r in (0, rows // 2, rows - 1)]
    lines += [((0, rows), (c, c + 1)) for c in (0, columns // 2, columns - 1)]
    low, high = _PLAUSIBLE
    return all(bool(((f := flat.factor(line)) > low).all() and (f < high).all()) for line in lines)


def _black_level(path: str) -> float | None:
    """Mean of the tag BlackLevel of a TIFF (short or long integers); None where it cannot be read."""
    try:
        with Path(path).open("rb") as file:
            order = {b"II*\0": "<", b"MM\0*": ">"}[file.read(4)]
            file.seek(struct.unpack(f"{order}I", file.read(4))[0])
            (count,) = struct.unpack(f"{order}H", file.read(2))
            entries = file.read(12 * count)
            for tag, kind, many, held in struct.iter_unpack(f"{order}HHI4s", entries):
                if tag == _BLACK_LEVEL and kind in (3, 4) and 0 < many <= 16:
                    size, code = (2, "H") if kind == 3 else (4, "I")
                    if size * many > 4:
                        file.seek(struct.unpack(f"{order}I", held)[0])
                        held = file.read(size * many)
                    values = struct.unpack(f"{order}{many}{code}", held[: size * many])
                    return sum(values) / many
    except (OSError, ValueError, KeyError, struct.error):
        return None
    return None
