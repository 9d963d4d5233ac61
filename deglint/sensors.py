"""Sensor presets: for each sensor, its bands, band delays and optics.

The data are in `sensors.toml` beside this module, with their sources. Values that are not known are None. A status says
where values come from: "verified" (a public source was read), "unverified" (often quoted, but no source was read) or
"defined" (a made-up sensor, or values that the user gives).
"""

from __future__ import annotations  # `deglint.readers.bands` reads types of fields as text

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, cast

from .checks import from_plain
from .errors import InputError

UNVERIFIED = "unverified"


@dataclass(frozen=True, slots=True)
class BandInfo:
    """One band of a sensor: name, wavelength and width [nm], and time offset [s]."""

    name: str  # as the manufacturer calls it
    wavelength: float  # centre [nm]
    width: float  # full width, or distance of the band edges, as the source has it [nm]
    aliases: tuple[str, ...] = ()  # other names of the band in files
    time_offset: float | None = None  # time of the band after the first band [s]
    time_status: str | None = None  # where `time_offset` comes from; None without an offset
    group: str | None = None  # a name; bands with the same group are taken at (nearly) the same time

    def answers_to(self, name: str) -> bool:
        """Whether `name` is this band's name or one of its aliases; case, blanks and punctuation are ignored."""
        return normalise(name) in map(normalise, (self.name, *self.aliases))


@dataclass(frozen=True, slots=True)
class Optics:
    """Optics of a sensor: aperture and focal length [m], pixel pitch [um] and f-number; None where not known."""

    aperture: float | None = None  # diameter [m]
    focal_length: float | None = None  # [m]
    pixel_pitch: float | None = None  # distance between pixels of the multispectral detector [um]
    f_number: float | None = None  # focal length over aperture; computed from both if not stated
    status: str = UNVERIFIED  # where these values come from


@dataclass(frozen=True, slots=True)
class SensorInfo:
    """A sensor preset: bands, optics, aliases, and the source and status of the data."""

    name: str  # short name
    title: str  # full name
    bands: tuple[BandInfo, ...]  # in the order of the manufacturer's product
    ordered: bool = True  # False: the order of bands differs between products; they are matched by name or wavelength
    wavelength_status: str = UNVERIFIED  # where the wavelengths of the bands come from; same for widths, groups
    width_status: str = UNVERIFIED  # where the widths come from; by default as those of the wavelengths
    group_status: str = UNVERIFIED
    pixel: float | None = None  # nominal size of a pixel on the ground [m]; None for aircraft and drones
    optics: Optics | None = None
    products: tuple[tuple[str, ...], ...] = ()  # names of the bands of products with fewer bands, in their order
    aliases: tuple[str, ...] = ()  # other names of the preset
    sources: tuple[str, ...] = ()  # of the data

    def product(self, count: int) -> tuple[BandInfo, ...]:
        """Bands, in order, of the product with `count` bands; empty if there is none, or if the order of bands varies.

        >>> [b.name for b in load("sentinel2").product(4)]
        ['B02', 'B03', 'B04', 'B08']
        """
        if not self.ordered:
            return ()
        if count == len(self.bands):
            return self.bands
        own = {b.name: b for b in self.bands}
        return next((tuple(own[n] for n in names) for names in self.products if len(names) == count), ())

    @property
    def counts(self) -> tuple[int, ...]:
        """Numbers of bands of the sensor's known products; empty if the order of bands differs between products."""
        return tuple(sorted({len(self.bands), *map(len, self.products)})) if self.ordered else ()


def names() -> tuple[str, ...]:
    """Names of the sensor presets."""
    return tuple(_table())


def load(name: str) -> SensorInfo:
    """The sensor preset with this name or alias; case, blanks and punctuation are ignored.

    Raises
    ------
    InputError
        If there is no such preset; the message lists the presets.

    Examples
    --------
    >>> load("WorldView-3").bands[6].wavelength
    832.5
    """
    if (found := find(name)) is None:
        raise InputError(f"no sensor preset {name!r}; choose one of {', '.join(names())}, or give --sensor FILE.toml.")
    return found


def find(name: str) -> SensorInfo | None:
    """The sensor preset with this name or alias, as in `load`, but None if there is no such preset."""
    wanted, every = normalise(name), _table().values()
    return next((s for s in every if wanted in map(normalise, (s.name, *s.aliases))), None)


def normalise(name: str) -> str:
    """Convert a name to lower case and remove all but letters and digits: "Red Edge" becomes "rededge"."""
    return re.sub(r"[\W_]+", "", name.casefold())


@cache
def _table() -> dict[str, SensorInfo]:
    import tomllib
    from importlib.resources import files

    text = files(__package__).joinpath("sensors.toml").read_text(encoding="utf-8")
    return {name: sensor_from(name, entry) for name, entry in tomllib.loads(text).items()}


def sensor_from(name: str, entry: Mapping[str, Any]) -> SensorInfo:
    """Make the sensor `name` from `entry`, its checked table of `sensors.toml` or of a user's file."""
    values = {"width_status": entry["wavelength_status"], **entry, "name": name}
    time_status = {"time_status": entry.get("time_status", UNVERIFIED)}
    values["bands"] = [(time_status if "time_offset" in band else {}) | band for band in entry["bands"]]
    optics = dict(entry.get("optics", {}))
    if "aperture" in optics and "focal_length" in optics:
        values["optics"] = {"f_number": round(optics["focal_length"] / optics["aperture"], 2), **optics}
    return cast("SensorInfo", from_plain(SensorInfo, values))
