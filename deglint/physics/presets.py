"""Sensor presets for simulations and plans.

Band edges are published values. Full-scale radiances, full-well capacities, read noise and band delays are round,
typical numbers where they are not published. The sensor "thesis", after the thesis of Fink (2014), is assumed to be an
airborne imager with the bands of WorldView.
"""

from dataclasses import replace

from ._checks import choice
from .sensor import Sensor, SensorBand

_WORLDVIEW_BANDS = (  # name, lower and upper edge [nm], full scale [W m-2 sr-1 nm-1], time offset of WorldView-3 [s]
    ("COASTAL", 400, 450, 0.207, 0.008),
    ("BLUE", 450, 510, 0.247, 0.300),
    ("GREEN", 510, 580, 0.239, 0.308),
    ("YELLOW", 585, 625, 0.226, 0.016),
    ("RED", 630, 690, 0.207, 0.316),
    ("REDEDGE", 705, 745, 0.178, 0.024),
    ("NIR1", 770, 895, 0.137, 0.324),
    ("NIR2", 860, 1040, 0.091, 0.0),
)
_MICASENSE_BANDS = (  # the same columns; the full scales are those of an exposure that suits water
    ("BLUE", 465, 485, 0.10, 0.0),
    ("GREEN", 550, 570, 0.10, 0.0),
    ("RED", 663, 673, 0.08, 0.0),
    ("NIR", 820, 860, 0.05, 0.0),
    ("REDEDGE", 712, 722, 0.07, 0.0),
)
_SENTINEL_BANDS = (  # the same columns; the bands with 10 m pixels
    ("B02", 458, 523, 0.615, 0.0),
    ("B03", 543, 578, 0.559, 0.527),
    ("B04", 650, 680, 0.484, 1.005),
    ("B08", 785, 900, 0.308, 0.264),
)


def _bands(rows: tuple[tuple[str, float, float, float, float], ...]) -> tuple[SensorBand, ...]:
    return tuple(
        SensorBand(name=name, low=low, high=high, full_scale=full, time_offset=offset)
        for name, low, high, full, offset in rows
    )


_THESIS_SENSOR = Sensor(
    name="thesis", bands=_bands(_WORLDVIEW_BANDS), gsd=0.25, f_number=10.0, pitch=8e-6, smear=0.5
).delayed(0.060)

PRESETS: dict[str, Sensor] = {
    "thesis": _THESIS_SENSOR,
    "thesis-f30": replace(_THESIS_SENSOR, name="thesis-f30", f_number=30.0),
    "worldview3": Sensor(
        name="worldview3",
        bands=tuple(replace(b, full_scale=2 * b.full_scale) for b in _bands(_WORLDVIEW_BANDS)),
        gsd=1.24,
        f_number=12.1,  # assumed, like the pitch; `deglint.sensors` has other, unverified values
        pitch=26.7e-6,
        bits=11,
    ),
    "micasense": Sensor(
        name="micasense",
        bands=_bands(_MICASENSE_BANDS),
        gsd=0.08,
        f_number=2.8,
        pitch=3.75e-6,
        smear=0.1,
        well=15_000.0,
        read_noise=10.0,
    ),
    "sentinel2": Sensor(name="sentinel2", bands=_bands(_SENTINEL_BANDS), gsd=10.0, f_number=4.0, pitch=7.5e-6),
}


def preset(name: str) -> Sensor:
    """Return the sensor with this name in `PRESETS`; raise InputError, which lists the presets, if there is none.

    Examples
    --------
    >>> preset("worldview3").gsd
    1.24
    """
    choice("preset", name, PRESETS)
    return PRESETS[name]
