"""Write the results of models: simulated scenes, and plans.

A simulated scene is written as GeoTIFFs of the image and of its ground truth, and a JSON file with all parameters. A
plan has values for each viewing geometry (zenith and azimuth of the sensor); it is written as a picture (.png), numbers
(.json), NetCDF (.nc) or a GeoTIFF in polar coordinates (.tif). Either all files are written, or none.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from affine import Affine

from .. import __version__
from ..errors import InputError, WriteError
from .output import Layer, plain, write_bytes, write_json
from .targets import Reads, Scratch, check_targets, write_errors

if TYPE_CHECKING:
    from ..plan.reticle import Reticle
    from ..simulate import Setup, SimulatedScene

CRS = "EPSG:32610"  # of every scene: UTM zone 10 north
CORNER = 600_000.0, 4_070_000.0  # upper left corner of every scene [m], at sea off California
Content = bytes | Mapping[str, object] | Callable[[Path], None]
"""Content of a file: bytes, values for JSON, or a function that writes the file with a given path."""
_SIGNED = {"software": f"deglint {__version__}"}


def write_scene(
    scene: "SimulatedScene", stem: str | Path, *, overwrite: bool = False, truth: bool = True
) -> list[Path]:
    """Write a simulated scene: the image ``DIR/NAME.tif``, its ground truth ``DIR/NAME_*.tif``, and ``DIR/NAME.json``.

    `stem` is ``DIR/NAME``. Without `truth`, the ground truth is not written. Returns the paths. Raises WriteError if a
    file cannot be written; then no file is written.
    """
    base = _base(stem)
    layers = {part: layer for part, layer in layers_of(scene).items() if truth or not part}
    targets = {part: base.with_name(f"{base.name}{part}.tif") for part in layers}
    sidecar = base.with_name(f"{base.name}.json")
    check_targets([*targets.values(), sidecar], overwrite=overwrite)
    gsd = scene.setup.sensor.gsd
    place: dict[str, Any] = {"crs": CRS, "transform": Affine(gsd, 0.0, CORNER[0], 0.0, -gsd, CORNER[1])}
    place |= {"tiled": True, "blockxsize": 256, "blockysize": 256, "interleave": "pixel", "num_threads": 2}
    contents: dict[Path, Content] = {targets[part]: partial(layer.write, **place) for part, layer in layers.items()}
    contents[sidecar] = describe(scene, {part: target.name for part, target in targets.items()})
    write_files(contents, overwrite=overwrite)
    return [*targets.values(), sidecar]


def planned_files(stem: str | Path, setup: "Setup", *, surface: bool) -> dict[Path, int]:
    """Uncompressed size [byte] of each file of `write_scene` (0 for JSON); `surface` adds sea height and slopes."""
    base, count, pixels = _base(stem), len(setup.sensor.bands), math.prod(setup.size)
    sizes = {"": 2 * count, "_truth": 4 * count, "_truth_water": 4 * count, "_truth_noisy": 2 * count}
    sizes |= {"_glint": 4 * count, "_glint_mask": count, "_objects": 2}
    sizes |= {"_cover": count} if setup.coast or setup.foam or setup.targets else {}
    sizes |= ({"_depth": 4} if setup.bottom else {}) | ({"_height": 4, "_slopes": 8} if surface else {})
    rasters = {base.with_name(f"{base.name}{part}.tif"): size * pixels for part, size in sizes.items()}
    return rasters | {base.with_name(f"{base.name}.json"): 0}


def _base(stem: str | Path) -> Path:
    path = Path(stem)
    if not path.name:
        raise WriteError(f"{str(stem)!r} is no name for a scene; give one, such as {path / 'scene'}.")
    return path.with_suffix("") if path.suffix.lower() in {".tif", ".tiff"} else path


def layers_of(scene: "SimulatedScene") -> dict[str, Layer]:
    """Image and ground truth of a simulated scene as a `Layer` each, by the suffix of its file ("" for the image)."""
    setup, sensor = scene.setup, scene.setup.sensor
    names = tuple(b.name for b in sensor.bands)
    tags = tuple({"wavelength": f"{b.wavelength:g}", "time_offset_s": f"{b.time_offset:.3f}"} for b in sensor.bands)
    radiance: dict[str, Any] = {"units": ("W m-2 sr-1 nm-1",) * len(names), "band_tags": tags}
    numbers = radiance | {"scales": tuple(sensor.scale(b) for b in sensor.bands), "tags": _tags(setup)}
    truth = "radiance out of the water {}, without sun glint{} and noise, through the same optics"
    glint = f"1 where glint exceeds {setup.glint_threshold:g} of the radiance without it"
    cover = "0 open water, 1 land, 2 foam, 3 floating target, when the band sees it"
    out = {
        "": Layer(scene.image, "what the sensor gives", names, **numbers),
        "_truth": Layer(scene.truth, truth.format("and of the mirrored sky", ""), names, **radiance),
        "_truth_water": Layer(scene.truth_water, truth.format("alone", ", mirrored sky"), names, **radiance),
        "_truth_noisy": Layer(
            scene.truth_image, "what the sensor gives without sun glint, same noise", names, **numbers
        ),
        "_glint": Layer(scene.glint, "radiance of the sun glint alone, through the same optics", names, **radiance),
        "_glint_mask": Layer(scene.glint_mask.astype(np.uint8), glint, names, band_tags=tags),
        "_objects": Layer(scene.objects[None], "number of the submerged object, from 1; see the JSON", ("object",)),
    }
    if scene.cover is not None:
        out["_cover"] = Layer(scene.cover, cover, names, band_tags=tags)
    if scene.depth is not None:
        out["_depth"] = Layer(scene.depth[None], "depth of the bottom", ("depth",), ("m",))
    if scene.height is not None:
        out["_height"] = Layer(scene.height[None], "height of the sea at the first time", ("height",), ("m",))
    if scene.slopes is not None:
        out["_slopes"] = Layer(scene.slopes, "slope of the sea at the first time", ("east", "north"))
    return out


def _tags(setup: "Setup") -> dict[str, str]:
    sensor = setup.sensor
    angles = ("sun_zenith", "sun_azimuth", "view_zenith", "view_azimuth", "wind_from")
    numbers = {f"{name.upper()}_DEG": getattr(setup, name) for name in angles} | {"WIND_M_S": setup.wind}
    numbers |= {"F_NUMBER": sensor.f_number, "GSD_M": sensor.gsd, "SMEAR_PIXELS": sensor.smear}
    numbers |= {"PIXEL_PITCH_UM": 1e6 * sensor.pitch}
    said = {"SENSOR": sensor.name, "FULL_SCALE": str(sensor.levels)}
    return said | {k: f"{v:g}" for k, v in numbers.items()} | {"SEED": str(setup.seed)}


def describe(scene: "SimulatedScene", files: Mapping[str, str]) -> dict[str, object]:
    """Content of a scene's JSON file: parameters, statistics of each band, and `files`, the file names by suffix."""
    import scipy

    setup, light = scene.setup, scene.light
    layers = {"truth": scene.truth, "truth_water": scene.truth_water, "glint": scene.glint}
    bands = [
        {
            "name": band.name,
            "wavelength_nm": band.wavelength,
            "time_s": setup.times[i],
            "scale": setup.sensor.scale(band),
            "exposure_s": setup.sensor.exposure(band),
            "direct_irradiance": float(light.direct[i]),
            "diffuse_irradiance": float(light.diffuse[i]),
            "water_radiance": float(light.water[i]),
            **{f"mean_{name}": float(values[i].mean(dtype=np.float64)) for name, values in layers.items()},
            "glint_fraction": float(scene.glint_mask[i].mean()),
            "saturated_pixels": int((scene.image[i] == setup.sensor.levels).sum()),
        }
        for i, band in enumerate(setup.sensor.bands)
    ]
    return {
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "files": dict(files),
        "setup": asdict(setup) | {"air": asdict(setup.weather)},
        "grid_pixels": setup.grid,
        "facet_m": setup.facet,
        "slope_variance_up_cross": {"measured": setup.slope_variance, "resolved": scene.resolved_slope_variance},
        "bands": bands,
    }


def check_plan(targets: Sequence[Path], kinds: Sequence[str], reads: Reads, *, overwrite: bool) -> None:
    """Call `check_targets`. Raises InputError if one of `targets` has none of the endings `kinds` (".png", ...)."""
    for target in targets:
        if _kind(target) not in kinds:
            raise InputError(f"{target} must end in one of {', '.join(kinds)}, which says what to write.")
    check_targets(targets, reads, overwrite=overwrite)


def write_plan(plan: "Reticle", targets: Sequence[Path], picture: Callable[[], bytes], *, overwrite: bool) -> None:
    """Write a plan (`deglint.plan.Reticle`) to every target, in the format of its ending; `picture` returns the PNG."""
    from ..plan import dataset

    makers: Mapping[str, Callable[[], Content]] = {
        ".png": picture,
        ".json": lambda: (json.dumps(plain(_SIGNED | dataset.document(plan)), allow_nan=False) + "\n").encode(),
        ".nc": lambda: partial(
            dataset.dataset(plan).assign_attrs(_SIGNED).to_netcdf, engine="scipy", format="NETCDF3_64BIT"
        ),
        ".tif": lambda: partial(_geotiff, plan),
    }
    write_files({target: makers[_kind(target)]() for target in targets}, overwrite=overwrite)


def write_files(targets: Mapping[Path, Content], *, overwrite: bool) -> None:
    """Write several files: either all, or none. `targets` has the content of each file by its path."""
    with Scratch(overwrite=overwrite) as scratch:
        for target, data in targets.items():
            if isinstance(data, Mapping):
                write_json(scratch, target, {**_SIGNED, **data})
            elif callable(data):
                with write_errors(target):
                    data(scratch.add(target))
            else:
                write_bytes(scratch, target, data)


def _kind(target: Path) -> str:
    ending = target.suffix.lower()
    return ".tif" if ending == ".tiff" else ending


def _geotiff(plan: "Reticle", path: Path) -> None:
    """Write a plan as GeoTIFF without CRS: a band per layer, a row per zenith angle, a column per azimuth [degree]."""
    from ..plan.dataset import BAND_LAYERS, LAYERS, layer

    known = [(name, unit, layer(plan, name)) for name, (unit, _) in LAYERS.items()]
    for name, (unit, _) in BAND_LAYERS.items():
        known += [(f"{name} {band}", unit, layer(plan, name)[k]) for k, band in enumerate(plan.bands)]
    names, units, layers = zip(*known, strict=True)
    down, across = (float(axis[1] - axis[0]) for axis in (plan.zenith, plan.azimuth))
    meaning = "look from: columns are azimuths, rows zenith angles of the sensor [degree]"
    sun = "zenith {:.3f}, azimuth {:.3f}".format(*plan.mission.sun)
    found = Layer(np.stack(layers).astype(np.float32), meaning, names, units, tags={"SUN": sun})
    found.write(path, interleave="band", transform=Affine(across, 0.0, -0.5 * across, 0.0, down, -0.5 * down))
