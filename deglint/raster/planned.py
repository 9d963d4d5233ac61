"""Write a plan: a picture (.png), numbers (.json), NetCDF (.nc) or a GeoTIFF in polar coordinates (.tif).

A plan has values for each viewing geometry (zenith and azimuth of the sensor). All its files are written, or none.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..errors import InputError
from .output import Layer, plain, write_bytes, write_json
from .scratch import Scratch, write_errors
from .targets import Reads, check_targets

Content = bytes | Mapping[str, Any] | Callable[[Path], None]
"""Content of a file: bytes, values for JSON, or a function that writes the file with a given path."""
_SIGNED = {"software": f"deglint {__version__}"}


def check_plan(
    targets: Sequence[Path], kinds: Sequence[str], reads: Reads | None = None, *, overwrite: bool = False
) -> None:
    """Check, before any computation, that the outputs can be written and end in one of `kinds` (".png", ...).

    `reads` are the names of input files, as in `check_targets`.
    """
    for target in targets:
        if _kind(target) not in kinds:
            raise InputError(f"{target} must end in one of {', '.join(kinds)}, which says what to write.")
    check_targets(targets, reads, overwrite=overwrite)


def write_plan(plan: Any, targets: Sequence[Path], picture: Callable[[], bytes], *, overwrite: bool = False) -> None:
    """Write a plan (`deglint.plan.Reticle`) to every target, in the format of its ending; `picture` makes the PNG."""
    from ..plan import dataset

    makers: Mapping[str, Callable[[], Content]] = {
        ".png": picture,
        ".json": lambda: (json.dumps(plain(_SIGNED | dataset.document(plan)), allow_nan=False) + "\n").encode(),
        ".nc": lambda: partial(_netcdf, dataset.dataset(plan)),
        ".tif": lambda: partial(_geotiff, plan),
    }
    write_numbers({target: makers[_kind(target)]() for target in targets}, overwrite=overwrite)


def write_numbers(targets: Mapping[Path, Content], *, overwrite: bool = False) -> None:
    """Write several files, all or none; `targets` has the path and the content of each."""
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


def _netcdf(data: Any, path: Path) -> None:
    data.attrs |= _SIGNED
    data.to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")


def _geotiff(plan: Any, path: Path) -> None:
    """Write one band per layer; columns are azimuths, rows are zenith angles, both in degrees; there is no CRS."""
    from affine import Affine

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
