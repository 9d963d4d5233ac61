"""Write a plan: a picture (.png), numbers (.json), NetCDF (.nc) or a GeoTIFF in polar coordinates (.tif).

All files of a plan are written, or none.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..errors import InputError, WriteError
from .info import unplaced
from .output import Scratch, plain, write_bytes, write_json, write_text
from .targets import Reads, check_targets

Plan = Any
"""Result of `deglint.plan.reticle`; that package is imported only when needed."""
PLANNED_ENDINGS = (".png", ".json", ".nc", ".tif")


def check_plan(
    targets: Sequence[Path],
    kinds: Sequence[str] = PLANNED_ENDINGS,
    reads: Reads | None = None,
    *,
    overwrite: bool = False,
) -> None:
    """Check, before any computation, that the outputs can be written; `reads` as in `check_targets`."""
    for target in targets:
        if _kind(target) not in kinds:
            raise InputError(f"{target} must end in one of {', '.join(kinds)}, which says what to write.")
    check_targets(targets, reads, overwrite=overwrite)


def write_plan(plan: Plan, targets: Sequence[Path], picture: Callable[[], bytes], *, overwrite: bool = False) -> None:
    """Write a plan (`deglint.plan.Reticle`) to every target, by its ending; `picture` returns the PNG."""
    from ..plan import dataset

    check_plan(targets, overwrite=overwrite)
    writers: Mapping[str, Callable[[Scratch, Path], None]] = {
        ".png": lambda scratch, target: write_bytes(scratch, target, picture()),
        ".json": lambda scratch, target: write_text(scratch, target, _compact(dataset.document(plan))),
        ".nc": lambda scratch, target: _netcdf(dataset.dataset(plan), scratch.add(target)),
        ".tif": lambda scratch, target: _geotiff(plan, scratch.add(target)),
    }
    with Scratch(overwrite=overwrite) as scratch:
        for target in targets:
            try:
                writers[_kind(target)](scratch, target)
            except OSError as error:
                if isinstance(error, WriteError):
                    raise
                raise WriteError(f"cannot write {target}: {error}") from error


def write_numbers(targets: Mapping[Path, bytes | Mapping[str, Any]], *, overwrite: bool = False) -> None:
    """Write pictures (bytes) and values (for JSON) together, or none of them."""

    check_plan(list(targets), (".png", ".json"), overwrite=overwrite)
    with Scratch(overwrite=overwrite) as scratch:
        for target, data in targets.items():
            if isinstance(data, bytes):
                write_bytes(scratch, target, data)
            else:
                write_json(scratch, target, _signed(data))


def _kind(target: Path) -> str:
    ending = target.suffix.lower()
    return ".tif" if ending == ".tiff" else ending


def _signed(document: Mapping[str, Any]) -> dict[str, Any]:
    return {"software": f"deglint {__version__}", **document}


def _compact(document: Mapping[str, Any]) -> str:
    """JSON with each table and each layer on one line; the layers contain only finite numbers."""

    head = {k: v for k, v in document.items() if k != "layers"}
    lines = [f"{json.dumps(k)}: {json.dumps(plain(v), allow_nan=False)}" for k, v in _signed(head).items()]
    layers = [f"{json.dumps(k)}: {json.dumps(v, allow_nan=False)}" for k, v in document["layers"].items()]
    return "{\n" + ",\n".join([*lines, '"layers": {\n' + ",\n".join(layers) + "\n}"]) + "\n}\n"


def _netcdf(data: Any, path: Path) -> None:
    data.attrs["software"] = f"deglint {__version__}"
    data.to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")


def _geotiff(plan: Plan, path: Path) -> None:
    """One band per layer, columns are azimuths, rows zenith angles, both in degrees; no CRS."""
    import rasterio
    from affine import Affine

    from ..plan.dataset import BAND_LAYERS, LAYERS, layer

    known = [(name, unit, layer(plan, name)) for name, (unit, _) in LAYERS.items()]
    for name, (unit, _) in BAND_LAYERS.items():
        known += [(f"{name} {band}", unit, layer(plan, name)[k]) for k, band in enumerate(plan.bands)]
    names, units, layers = zip(*known, strict=True)
    down, across = (float(axis[1] - axis[0]) for axis in (plan.zenith, plan.azimuth))
    array = np.stack(layers).astype(np.float32)
    profile = {
        "driver": "GTiff", "dtype": "float32", "count": len(array), "height": array.shape[1],
        "width": array.shape[2], "compress": "deflate", "predictor": 3, "interleave": "band",
        "transform": Affine(across, 0.0, -0.5 * across, 0.0, down, -0.5 * down),
    }  # fmt: skip
    with unplaced(), rasterio.open(path, "w", **profile) as out:
        out.write(array)
        out.descriptions, out.units = names, units
        out.update_tags(
            MEANING="look from: columns are azimuths, rows zenith angles of the sensor [degree]",
            SOFTWARE=f"deglint {__version__}",
            SUN=f"zenith {plan.mission.sun[0]:.3f}, azimuth {plan.mission.sun[1]:.3f}",
        )
