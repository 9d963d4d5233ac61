"""Sensor presets for simulations and plans; the data are in `presets.toml` beside this module.

Band edges are published values. Full-scale radiances, full-well capacities, read noise and band delays are round,
typical numbers where they are not published. The sensor "thesis", after the thesis of Fink (2014), is assumed to be an
airborne imager with the bands of WorldView.
"""

import tomllib
from collections.abc import Iterator
from dataclasses import replace
from importlib.resources import files

from ..checks import check_choice
from .sensor import Sensor, SensorBand


def _presets() -> Iterator[Sensor]:
    text = files(__package__).joinpath("presets.toml").read_text(encoding="utf-8")
    for name, entry in tomllib.loads(text).items():
        rows = (zip(("name", "low", "high", "full_scale", "time_offset"), row, strict=True) for row in entry["bands"])
        sensor = Sensor(**entry | {"name": name, "bands": tuple(SensorBand(**dict(row)) for row in rows)})
        yield sensor
        if name == "thesis":  # the same with a smaller aperture
            yield replace(sensor, name="thesis-f30", f_number=30.0)


PRESETS: dict[str, Sensor] = {sensor.name: sensor for sensor in _presets()}


def preset(name: str) -> Sensor:
    """Return the sensor with this name in `PRESETS`; raise InputError, which lists the presets, if there is none.

    Examples
    --------
    >>> preset("worldview3").gsd
    1.24
    """
    check_choice(name, list(PRESETS), "preset")
    return PRESETS[name]
