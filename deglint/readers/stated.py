"""Properties of bands given by the user: names, wavelengths, scale and offset, overriding those of the file.

They are stored in the description of the file, so that all later steps, and the output, use them.
"""

from __future__ import annotations

import math
import numbers
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..checks import described
from ..errors import InputError
from ..raster import RasterInfo
from .names import example_names
from .spectral import SPECTRAL_RANGE, Spectral, nanometres, with_spectral

Names = str | Sequence[str]
Numbers = str | float | Sequence[float]


@dataclass(frozen=True)
class Stated:
    """Properties of bands given by the user; one entry per band, or none."""

    names: tuple[str, ...] = ()
    wavelengths: tuple[float, ...] = ()  # [nm]
    scales: tuple[float, ...] = ()  # physical = number in the file * scale + offset
    offsets: tuple[float, ...] = ()  # of scales and offsets a single entry is for all bands

    @classmethod
    def of(
        cls, bands: Names | None, wavelengths: Numbers | None, scale: Numbers | None, offset: Numbers | None
    ) -> Stated:
        """Parse and check the options."""
        return cls(
            _names(bands),
            tuple(_nanometres(w) for w in _numbers("wavelengths", wavelengths, "475,560,668,842")),
            tuple(_numbers("scale", scale, "0.0001", zero=False)),
            tuple(_numbers("offset", offset, "-0.1")),
        )

    @property
    def count(self) -> int | None:
        """Number of bands that are given one by one."""
        return max(len(self.names), len(self.wavelengths)) or None

    def on(self, info: RasterInfo) -> RasterInfo:
        """Store the properties in the description of the stacked bands."""
        total, path = info.count, ", ".join(info.paths)
        scales, offsets = (v * total if len(v) == 1 else v for v in (self.scales, self.offsets))
        for option, count, example in (
            ("bands", len(self.names), f'"{example_names(total)}"; -b chooses bands'),
            ("wavelengths", len(self.wavelengths), "475,560,..."),
            ("scale", len(scales), "N, one for all of them"),
            ("offset", len(offsets), "N, one for all of them"),
        ):
            if count not in (0, total):
                raise InputError(
                    f"--{option} gives {count} and {path} has {total} band{'s' if total > 1 else ''}. Give one for "
                    f"each band, in the file's order: --{option} {example}."
                )
        return replace(
            with_spectral(info, [Spectral(w) for w in self.wavelengths]) if self.wavelengths else info,
            descriptions=self.names or info.descriptions,
            scales=scales or info.scales,
            offsets=offsets or info.offsets,
            offset_given=bool(offsets) or info.offset_given,
        )


def _names(given: Names | None) -> tuple[str, ...]:
    if given is None:
        return ()
    parts = given.split(",") if isinstance(given, str) else given
    if not isinstance(parts, (list, tuple)) or not all(isinstance(p, str) for p in parts):
        raise InputError(f'bands: want names such as "blue,green,red,nir" or a list of them, got {described(given)}.')
    names = tuple(p.strip() for p in parts)
    if not all(names):
        raise InputError(f"--bands: name {names.index('') + 1} of {len(names)} is empty. Name every band.")
    if all(re.fullmatch(r"\d{1,2}", n) for n in names):
        raise InputError(
            f"--bands {','.join(names)}: --bands gives bands their names, such as --bands "
            f'"{example_names(len(names))}". To choose bands by number, use -b {",".join(names)}.'
        )
    twice = [n for i, n in enumerate(names) if n.casefold() in [m.casefold() for m in names[:i]]]
    if twice:
        raise InputError(f"--bands gives two bands the name {twice[0]!r}. Give each its own.")
    return names


def _numbers(option: str, given: Numbers | None, example: str, *, zero: bool = True) -> list[float]:
    if given is None:
        return []
    if isinstance(given, str):
        parts: Sequence[object] = given.split(",")
    else:
        listed = given.tolist() if hasattr(given, "tolist") else given  # an array
        parts = listed if isinstance(listed, (list, tuple)) else [listed]
    found = []
    for part in parts:
        try:
            fits = isinstance(part, (str, numbers.Real)) and not isinstance(part, bool)
            value = float(part) if fits else math.nan  # type: ignore[arg-type]
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or (value == 0 and not zero):
            what = "numbers" if zero else "numbers other than 0"
            raise InputError(f"--{option}: want {what} such as {example}, got {described(given)}.")
        found.append(value)
    return found


def _nanometres(value: float) -> float:
    found, _ = nanometres(value)
    if found is None or not SPECTRAL_RANGE[0] <= found <= SPECTRAL_RANGE[1]:
        low, high = SPECTRAL_RANGE
        raise InputError(
            f"--wavelengths: allowed is {low:g} to {high:g} nm (or 0.1 to {high / 1000:g} um), got {value:g}."
        )
    return found
