"""Grids of setups: every combination of wind, band delay, viewing geometry and optics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

from .setup import Setup

WINDS = (2.0, 5.0, 9.0, 12.0)
"""[m/s]"""
DELAYS = (0.0, 0.010, 0.060)
"""From each band to the next [s]."""
LOOKS = ((0.0, 0.0), (20.0, 180.0), (40.0, 180.0), (40.0, 90.0), (40.0, 0.0))
"""View zenith angle, and azimuth of the sensor from that of the sun, both as seen from the target [deg]."""
F_NUMBERS = (10.0, 30.0)


def experiments(
    base: Setup,
    *,
    winds: Sequence[float] = WINDS,
    delays: Sequence[float] = DELAYS,
    looks: Sequence[tuple[float, float]] = LOOKS,
    f_numbers: Sequence[float] = F_NUMBERS,
) -> Iterator[tuple[str, Setup]]:
    """Name and setup of every combination.

    Parameters
    ----------
    base : Setup
        Everything that is not varied; its sun, too.
    winds : sequence of float
        [m/s]
    delays : sequence of float
        From each band to the next [s].
    looks : sequence of (float, float)
        View zenith angle, and azimuth from the sun [deg].
    f_numbers : sequence of float
        Of the optics.

    Yields
    ------
    (str, Setup)
        The name holds wind [m/s], delay [ms], viewing geometry [deg] and f-number. Scenes that differ only in delay or
        optics have the same seed, so they see the same sea.

    Examples
    --------
    >>> [name for name, _ in experiments(Setup(), winds=[9.0], delays=[0.06], looks=[(0.0, 0.0)])]
    ['wind09_delay060_view00_000_f10', 'wind09_delay060_view00_000_f30']
    """
    for place, (wind, (zenith, turn)) in enumerate(product(winds, looks)):
        for delay, f_number in product(delays, f_numbers):
            name = f"wind{wind:02g}_delay{1000 * delay:03.0f}_view{zenith:02g}_{turn:03g}_f{f_number:g}"
            yield (
                name,
                replace(
                    base,
                    wind=wind,
                    view_zenith=zenith,
                    view_azimuth=(base.sun_azimuth + turn) % 360,
                    sensor=replace(base.sensor.delayed(delay), f_number=f_number),
                    seed=base.seed + place,
                ),
            )
