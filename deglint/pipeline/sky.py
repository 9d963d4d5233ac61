"""Sky glint of a scene: what the sea mirrors of the light of the sky. It is modelled, not removed.

A removal of sun glint does not measure it, as it is nearly even over a scene. CEOS-ARD Aquatic Reflectance asks for its
amount (see `deglint.pipeline.flags`).
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..physics import sky
from ..physics.atmosphere import WAVELENGTH_RANGE, Air, irradiance
from ..physics.glint import VIEW_LIMIT
from ..readers.products.metadata import number
from ..scene import Scene
from .overview import raster_of

log = logging.getLogger("deglint.pipeline")

MODEL = "harrison-coombes"
"""The sky of the value: clear, as the irradiance is, and as it is where sun glint is seen."""
SKY_WINDS = (5.0, 1.0, 15.0)
"""Wind of the value and of the range [m/s]: the default of simulations, calm and strong; where it is not stated."""
VISIBILITIES = (40.0, 15.0, 80.0)
"""Visibility of the value and of the range [km]: the default of plans and simulations, haze and hardly any."""
_TAGS = {"sun zenith angle": ("sun_zenith_deg", "sun_elevation"), "sun azimuth": ("sun_azimuth_deg", "sun_azimuth"),
         "view zenith angle": ("view_zenith_deg", "view_elevation"),
         "view azimuth": ("view_azimuth_deg", "view_azimuth")}  # fmt: skip


def sky_glint(scene: Scene) -> dict[str, Any] | None:
    r"""Sky-glint reflectance at the water surface, for each band: the same for all pixels.

    .. math:: \rho = \pi L / (E_{sun} + E_{sky})

    with L the mirrored radiance (`deglint.physics.sky.reflectance`) and the irradiance of Gregg and Carder (1990).

    Parameters
    ----------
    scene : Scene
        Its tags state where the sun and the sensor stand, as those of some products and of simulated scenes do.

    Returns
    -------
    dict or None
        `reflectance` of each band of 300 to 1000 nm by name [1]; `range`, the lowest and the highest over three skies,
        `VISIBILITIES` and `SKY_WINDS`; and from what they follow. None where the scene does not state it; the log then
        says so.
    """
    tags = {k.casefold(): v for part in raster_of(scene).info.tags.values() for k, v in part.items()}
    stated = {name: _angle(tags, *names, zenith="zenith" in name) for name, names in _TAGS.items()}
    angles = {name: angle for name, angle in stated.items() if angle is not None}
    low, high = WAVELENGTH_RANGE
    known = {b.name: b.wavelength for b in scene.bands if b.wavelength and low <= b.wavelength <= high}
    missing = [name for name in _TAGS if name not in angles]
    missing += [] if known else [f"a wavelength of {low:g} to {high:g} nm"]
    if missing:
        log.info("sky glint: not modelled, the scene does not state: %s", ", ".join(missing))
        return None
    wind, blows_from = number(tags.get("wind_m_s")) or 0.0, number(tags.get("wind_from_deg")) or 0.0
    winds = (wind,) if 0.0 < wind <= max(SKY_WINDS) else SKY_WINDS
    sun, sun_azimuth, view, view_azimuth = angles.values()
    place = view, view_azimuth, sun, sun_azimuth
    mirrored = {
        model: np.pi * sky.reflectance(*place, wind=winds, wind_from=blows_from, model=model)
        for model in sky.SKY_MODELS
    }
    air = Air(humidity=80.0, water_vapour=2.5, wind=winds[0], wind_mean=winds[0])  # as plans and simulations have it
    light = [irradiance(list(known.values()), sun, air, visibility=v) for v in VISIBILITIES]
    share = np.array([x.diffuse / (x.diffuse + x.direct) for x in light])
    every = np.multiply.outer(np.array(list(mirrored.values())).ravel(), share)
    value = dict(zip(known, map(float, mirrored[MODEL][0] * share[0]), strict=True))
    said = ", ".join(f"{name} {v:.4f}" for name, v in value.items())
    log.info("sky glint: modelled, not removed; reflectance at the surface %s", said)
    return {
        "reflectance": value,
        "range": dict(zip(known, np.stack([every.min(axis=(0, 1)), every.max(axis=(0, 1))], axis=1), strict=True)),
        "removed": False,
        "angles": angles,
        "wind": winds[0],
        "wind_stated": winds is not SKY_WINDS,
        "visibility": VISIBILITIES[0],
        "sky": MODEL,
    }


def _angle(tags: Mapping[str, Any], name: str, other: str, *, zenith: bool) -> float | None:
    """An angle from its tag, a zenith angle also from an elevation; None where it is not stated or impossible."""
    angle = number(tags.get(name))
    if angle is None and (angle := number(tags.get(other))) is not None and zenith:
        angle = 90.0 - angle
    return None if angle is None or (zenith and not 0.0 <= angle <= VIEW_LIMIT) else angle
