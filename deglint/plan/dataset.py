"""Convert a plan to an xarray dataset, to named arrays over the viewing geometries, or to values for JSON."""

from typing import Any

import numpy as np

from ..errors import InputError
from .draw import Values
from .mission import tables_of
from .reticle import Reticle, ViewingGeometry, best_geometry, description

RADIANCE_UNIT = "W m-2 sr-1 nm-1"
LAYERS = {  # name: unit, meaning
    "glint_probability": ("1", "share of the sea that mirrors the sun"),
    "glint_strength": ("sr-1", "glint radiance per irradiance of a plane facing the sun"),
    "combined": ("1", "contrast over noise of all usable bands, 0 where it is excluded"),
    "clear_of_glint": ("1", "1 where sun glint is within its limit"),
    "excluded": ("1", "1 where no band is usable"),
}
BAND_LAYERS = {  # the same, for layers with an axis of bands
    "glint_radiance": (RADIANCE_UNIT, "sun glint"),
    "sky_radiance": (RADIANCE_UNIT, "mirrored skylight"),
    "background_radiance": (RADIANCE_UNIT, "out of the deep water"),
    "object_radiance": (RADIANCE_UNIT, "out of the water over the object"),
    "sky_probability": ("1", "share of the sea that mirrors more sky than the limit"),
    "weber": ("1", "Weber contrast of object and deep water"),
    "snr": ("1", "contrast over noise"),
    "by_band": ("1", "contrast over noise, 0 where it is excluded"),
    "clear_of_sky": ("1", "1 where mirrored sky is within its limit"),
    "detectable": ("1", "1 where contrast is above the noise limit and nothing saturates"),
}
# layers that the summary gives for each band at the best viewing geometry
_NUMBER_LAYERS = tuple(name for name in BAND_LAYERS if name not in ("clear_of_sky", "detectable", "by_band"))


def layer(plan: Reticle, name: str) -> Values:
    """Array of a plan: (zenith, azimuth) if `name` is in `LAYERS`, (band, zenith, azimuth) if in `BAND_LAYERS`."""
    out_of_water = {"background_radiance": plan.light.background, "object_radiance": plan.light.target}
    return np.asarray(out_of_water[name] if name in out_of_water else getattr(plan, name))


def dataset(plan: Reticle) -> Any:
    """Convert the plan to an `xarray.Dataset` over band, zenith and azimuth; each variable has a unit and a long name.

    Raises InputError if xarray is not installed.
    """
    try:
        import xarray
    except ImportError:
        raise InputError("this needs xarray: pip install 'deglint[xarray]', or write .json or .tif instead.") from None
    mission, geometries, where = plan.mission, ("zenith", "azimuth"), "of the sensor as seen from the object"

    def variable(axes: str | tuple[str, ...], values: Values, unit: str, meaning: str) -> tuple[object, ...]:
        kept = values.astype({"b": np.int8, "f": np.float32}[values.dtype.kind]) if values.ndim > 1 else values
        return axes, kept, {"units": unit, "long_name": meaning}

    data = {n: variable(geometries, layer(plan, n), *said) for n, said in LAYERS.items()}
    data |= {n: variable(("band", *geometries), layer(plan, n), *said) for n, said in BAND_LAYERS.items()}
    coordinates = {
        "band": ("band", np.array(plan.bands)),
        "wavelength": variable("band", np.array([b.wavelength for b in mission.channels]), "nm", "centre"),
        "zenith": variable("zenith", plan.zenith, "degrees", f"zenith angle {where}"),
        "azimuth": variable("azimuth", plan.azimuth, "degrees", f"azimuth {where}, clockwise from north"),
    }
    attributes = {
        "title": "glint avoidance plan: where to look from",
        "sun_zenith": mission.sun[0],
        "sun_azimuth": mission.sun[1],
        **{name: getattr(mission, name) for name in ("wind", "wind_from", "depth", "reflectance", "chlorophyll")},
        "sensor": mission.sensor.name,
        "glint_limit": mission.limits.glint,
        "words": description(best_geometry(plan)),
    }
    if mission.moment is not None:
        attributes["time"] = f"{mission.moment}Z"
    if mission.place is not None:
        attributes |= {"latitude": mission.latitude, "longitude": mission.longitude}
    return xarray.Dataset(data, coordinates, attrs=attributes)


def summary(plan: Reticle) -> dict[str, object]:
    """Summary of a plan for JSON: mission, sun, excluded share, texts; best viewing geometry with values by band."""
    geometry = best_geometry(plan)
    return {
        "mission": tables_of(plan.mission),
        "sun": dict(zip(("zenith", "azimuth"), plan.mission.sun, strict=True)),
        "excluded_share": excluded_share(plan),
        "best": None if geometry is None else _numbers(plan, geometry),
        "words": description(geometry),
        "cautions": list(plan.mission.cautions),
    }


def excluded_share(plan: Reticle) -> float:
    """Share of the viewing geometries that are excluded [1], weighted by solid angle."""
    weight = np.sin(np.radians(plan.zenith))[:, None] + np.zeros(plan.azimuth.size - 1)
    return float(np.average(plan.excluded[:, :-1], weights=weight))


def _numbers(plan: Reticle, geometry: ViewingGeometry) -> dict[str, object]:
    """Values of a viewing geometry for JSON: angles, contrast, glint and, by band, `_NUMBER_LAYERS` and electrons."""
    i, j = plan.nearest(geometry.zenith, geometry.azimuth)
    counts = plan.counts()
    return {
        "zenith": geometry.zenith,
        "azimuth": geometry.azimuth,
        "towards": geometry.heading,
        "contrast": geometry.contrast,
        "glint_strength": geometry.glint,
        "glint_probability": geometry.glint_probability,
        "away_from_excluded": geometry.margin,
        "bands": [
            {
                "band": name,
                "usable": bool(plan.by_band[k, i, j] > 0),
                **{n: float(layer(plan, n)[k, i, j]) for n in _NUMBER_LAYERS},
                "electrons": {part: float(values[k, i, j]) for part, values in counts.items()},
            }
            for k, name in enumerate(plan.bands)
        ],
    }


def document(plan: Reticle) -> dict[str, object]:
    """Convert a plan to values for JSON: its summary, and its arrays, rounded to four significant digits.

    Radiances and `by_band` are not included. The radiance of glint is `glint_strength` times the irradiance "normal";
    that of reflected sky is `sky_strength` times the irradiance "diffuse".
    """
    chosen = {**LAYERS, "sky_strength": ("sr-1", "mirrored skylight per diffuse irradiance")}
    chosen |= {n: said for n, said in BAND_LAYERS.items() if not n.endswith("_radiance") and n != "by_band"}
    layers = {n: {"unit": u, "meaning": m, "values": _rounded(layer(plan, n))} for n, (u, m) in chosen.items()}
    light = {"normal": plan.light.normal.tolist(), "diffuse": plan.light.diffuse.tolist(), "unit": "W m-2 nm-1"}
    axes = {"bands": list(plan.bands), "zenith": plan.zenith.tolist(), "azimuth": plan.azimuth.tolist()}
    return summary(plan) | axes | {"irradiance": light, "layers": layers}


def _rounded(values: Values) -> object:
    if values.dtype == bool:
        return values.astype(np.int8).tolist()
    values = values.astype(np.float64)
    scale = 10.0 ** (3.0 - np.floor(np.log10(np.maximum(np.abs(values), 1e-30))))
    return (np.rint(values * scale) / scale).tolist()
