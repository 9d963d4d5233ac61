"""What is known of the optics that took a scene: from its tags, or from the sensor's preset."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

from ..raster import RasterInfo
from ..scene import Scene
from .place import ground_size
from .products.metadata import number, positive
from .sensorfile import sensor_of


@dataclass(frozen=True, slots=True)
class KnownOptics:
    """What a system PSF is made of."""

    f_number: float  # focal length over aperture
    pitch: float  # of the detector [m]
    smear: float  # motion during the exposure along the columns [pixel]
    source: str  # where it was read


def optics_of(scene: Scene) -> KnownOptics | None:
    """Optics from the tags F_NUMBER, PIXEL_PITCH_UM and SMEAR_PIXELS, or from the preset; None where unknown."""
    info: RasterInfo | None = getattr(scene.source, "info", None)
    spaces = [] if info is None else info.tags.values()
    tags = {k.upper(): v for part in spaces for k, v in part.items()}
    f_number, pitch = positive(tags.get("F_NUMBER")), positive(tags.get("PIXEL_PITCH_UM"))
    if f_number and pitch:
        smear = number(tags.get("SMEAR_PIXELS"))
        return KnownOptics(f_number, 1e-6 * pitch, 0.5 if smear is None else smear, "the file's tags")
    sensor = sensor_of(scene.sensor) if scene.sensor else None
    if sensor is None or sensor.optics is None or sensor.optics.pixel_pitch is None:
        return None
    optics = sensor.optics
    ratio = optics.f_number
    if ratio is None:
        if not (optics.focal_length and optics.aperture):
            return None
        ratio = optics.focal_length / optics.aperture
    return KnownOptics(ratio, 1e-6 * cast(float, optics.pixel_pitch), 0.5, f"preset {sensor.name} ({optics.status})")


def pixel_size(scene: Scene) -> float | None:
    """Mean side of a pixel on the ground [m]; None where the scene does not say."""
    info = getattr(scene.source, "info", None)
    if scene.transform is None or scene.transform.is_identity:
        tags = info.tags.get("", {}) if info is not None else {}
        return positive(tags.get("GSD_M"))
    sides = ground_size(scene.transform, scene.crs, scene.height, scene.width)
    return None if sides is None else math.sqrt(sides[0] * sides[1])
