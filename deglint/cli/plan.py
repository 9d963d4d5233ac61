"""The command `deglint plan`: find viewing geometries without sun glint."""

import logging
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from .options import FILE, SENSOR_CHOICE, SKY_CHOICE, ChoiceFromTable, Decorator, Grouped, heading, messages, parsed

log = logging.getLogger(__name__)


def at(first: str, second: str, example: str) -> Callable[..., object]:
    """Make a click callback that parses "A@B" to {first: A, second: B}, or "A" to {first: A}; A and B are numbers."""

    def read(text: str) -> dict[str, float]:
        head, sign, tail = text.partition("@")
        return {first: float(head)} | ({second: float(tail)} if sign else {})

    return parsed(read, f"is not like {example}.")


def minutes(text: str) -> float:
    """Convert a duration, "30min", "0.5h" or "30" (minutes), to minutes. Raises ValueError unless it is 1 to 1440."""
    found = re.fullmatch(r"\s*([0-9.]+)\s*(min|m|h)?\s*", text)
    count = float(found[1]) * (60.0 if found[2] == "h" else 1.0) if found else 0.0
    if not 1.0 <= count <= 1440.0:
        raise ValueError
    return count


PLACES: dict[str, str] = {}  # for each option made by `setting`, the "table.key" of a mission file that it sets


def setting(option: str, place: str, unit: str | None, said: str, kind: type | click.ParamType = float) -> Decorator:
    """Make an option of type `kind` for `place`, a "table.key" of a mission file; `--help` shows `unit` and `said`."""
    PLACES[option[2:].replace("-", "_")] = place
    return click.option(option, type=kind, metavar=unit, help=said)


SAID = {
    "--wind": "Wind at 10 m @ azimuth it blows from.  [default: 5@0]",
    "--sky": "Model of the sky; harrison-coombes is clear.  [default: harrison-coombes]",
    "--max-glint-probability": "Largest share of the sea that mirrors the sun.  [default: any]",
    "--wind-within": "Uncertainty of wind speed and direction: find geometries that are good for every wind in it.",
    "--out": "Picture .png, numbers .json, .nc (xarray), GeoTIFF .tif in polar coordinates; may be repeated.",
}
"""Help texts that do not fit in the line of their option."""
SLOPES_CHOICE = ChoiceFromTable("MODELS", "deglint.physics.slopes")
WATER_CHOICE = ChoiceFromTable("WATERS", "deglint.plan.mission")
read_sun = at("zenith", "azimuth", "20.5@270.2, zenith angle @ azimuth [degree]")
read_wind = at("speed", "from", "7@310, speed [m/s] @ azimuth that it blows from [degree]")
read_range = at("speed", "turn", "2@30, speed [m/s] @ angle [degree]")
read_step = parsed(minutes, "is not like 30min or 1h, from 1 minute to a day.")


@click.command(cls=Grouped, context_settings={"help_option_names": ["-h", "--help"]})
@heading("Place, time and sun")
@click.option("--mission", type=FILE, metavar="FILE.toml", help="Mission file; options win over it.")
@setting("--lat", "place.latitude", "DEG", "Latitude, north positive.")
@setting("--lon", "place.longitude", "DEG", "Longitude, east positive.")
@click.option("--place", type=FILE, help="Raster or GeoJSON whose middle is the place.")
@setting("--time", "place.time", "ISO", "UTC, such as 2026-06-21T18:00Z.  [default: now]", str)
@click.option("--sun", callback=read_sun, metavar="ZENITH@AZIMUTH", help="The sun, in place of place and time.")
@heading("Wind and air")
@click.option("--wind", callback=read_wind, metavar="M/S@FROM", help=SAID["--wind"])
@setting("--wind-height", "wind.height", "M", "Height of the wind.  [default: 10]")
@setting("--wind-mean", "wind.mean", "M/S", "Mean wind of 24 hours.  [default: that of now]")
@setting("--visibility", "air.visibility", "KM", "Visibility.  [default: 40]")
@setting("--humidity", "air.humidity", "%", "Relative humidity.  [default: 80]")
@setting("--water-vapour", "air.water_vapour", "CM", "Column water vapour.  [default: 2.5]")
@setting("--air-mass", "air.air_mass_type", "1-10", "1: marine air, to 10: continental air.  [default: 1]")
@setting("--ozone", "air.ozone", "DU", "Ozone column.  [default: climatology]")
@setting("--pressure", "air.pressure", "HPA", "Air pressure, or with its unit, 29.9inHg.  [default: 1013.25]", str)
@setting("--slopes", "models.slopes", None, "Model of the slopes of waves.  [default: cox-munk]", SLOPES_CHOICE)
@setting("--sky", "models.sky", None, SAID["--sky"], SKY_CHOICE)
@heading("Target, water and sensor")
@setting("--depth", "object.depth", "M", "Depth of the object.  [default: 5]")
@setting("--reflectance", "object.reflectance", "SHARE", "Reflectance of the object.  [default: 0.15]")
@setting("--chlorophyll", "water.chlorophyll", "MG/M3", "Chlorophyll in the water.  [default: 0.5]")
@setting("--min-contrast", "limits.snr", "N", "Least contrast over noise that shows an object.  [default: 3]")
@setting("--ner", "limits.ner", "W", "Noise-equivalent radiance [W m-2 sr-1 nm-1].  [default: the sensor's own]")
@setting("--sensor", "sensor.preset", None, "Sensor.  [default: thesis]", SENSOR_CHOICE)
@click.option("-b", "--band", "bands", metavar="NAME,...", help="Bands to plan for.  [default: all]")
@setting("--water", "water.model", None, "Water scatters, or only absorbs.  [default: scattering]", WATER_CHOICE)
@heading("What is excluded")
@setting("--max-glint", "limits.glint", "1/SR", "Largest glint radiance / solar irradiance.  [default: 1e-3]")
@setting("--max-glint-probability", "limits.glint_probability", "SHARE", SAID["--max-glint-probability"])
@setting("--tolerance", "limits.tolerance", "DEG", "Angular radius of the sun.  [default: that of its disk]")
@setting("--max-sky-ratio", "limits.sky_ratio", "N", "Largest ratio of sky glint to water.  [default: 2]")
@setting("--max-sky-share", "limits.sky_probability", "SHARE", "Largest share of sea above that ratio.  [default: 0.1]")
@heading("When to fly")
@click.option("--from", "start", metavar="ISO", help="First time to compare.")
@click.option("--to", "end", metavar="ISO", help="Last time to compare.")
@click.option("--every", callback=read_step, metavar="30min", help="Step between the times.  [default: 30min]")
@heading("If the wind is uncertain")
@click.option("--wind-within", callback=read_range, metavar="M/S@DEG", help=SAID["--wind-within"])
@heading("Which way to fly")
@click.option("--fov", metavar="ACROSS[xALONG]", help="Field of view [degree]: best heading of a flight line.")
@click.option("--altitude", type=float, metavar="M", help="--fov: altitude above the sea.  [default: 300]")
@click.option("--pitch", type=float, metavar="DEG", help="--fov: forward tilt of the sensor.  [default: 0]")
@click.option("--roll", type=float, metavar="DEG", help="--fov: tilt to the right.  [default: 0]")
@heading("A page with sliders")
@click.option("--serve", is_flag=True, help="Open a page with sliders on this machine; Ctrl-C ends it.")
@click.option("--port", type=click.IntRange(0, 65535), metavar="N", help="--serve: port; 0: any free.  [default: 8765]")
@click.option("--no-browser", is_flag=True, help="--serve: only print the address.")
@heading("Output")
@click.option("-o", "--out", "outs", multiple=True, type=click.Path(path_type=Path), metavar="FILE", help=SAID["--out"])
@setting("--step", "view.step", "DEG", "Angle between viewing geometries.  [default: 1]")
@setting("--widest", "view.widest", "DEG", "Largest angle of the sensor off nadir.  [default: 80]")
@click.option("--show", metavar="BAND", help="Band in the picture.  [default: all together]")
@click.option("--overwrite", is_flag=True, help="Replace files that are there.")
@heading("Messages")
@click.option("--json", "as_json", is_flag=True, help="Print the plan in short as JSON on stdout.")
@messages
def plan(**given: Any) -> None:
    """Find the viewing geometries from which sun glint does not hide an object under water.

    \b
    deglint plan --lat 36.8 --lon -122 --time 2026-06-21T18:00Z --wind 7@310 -o plan.png
    deglint plan --mission survey.toml --depth 8 -o plan.png -o plan.json
    deglint plan --lat 36.8 --lon -122 --wind 7@310 --from 2026-06-21T13:00Z --to 2026-06-22T03:00Z -o day.png
    deglint plan --lat 36.8 --lon -122 --time 2026-06-21T18:00Z --wind 7@310 --wind-within 2@30 -o sure.png
    deglint plan --lat 36.8 --lon -122 --time 2026-06-21T18:00Z --wind 7@310 --fov 40 -o heading.png
    deglint plan --lat 36.8 --lon -122 --serve
    """
    from ..plan.mission import merged, mission_from
    from ..raster.simulated import check_plan
    from ..readers.text import read_toml
    from . import planning
    from .running import Console

    mode = planning.mode_of(given)
    reads = {"the mission": [given["mission"] or ""], "--place": [given["place"] or ""]}
    kinds = (".png", ".json", ".nc", ".tif") if mode is planning.one_reticle else (".png", ".json")
    check_plan(given["outs"], kinds, reads, overwrite=given["overwrite"])
    tables = merged(read_toml(given["mission"], "--mission") if given["mission"] else {}, _tables(given))
    with Console(given) as console:
        mission = mission_from(planning.by_daylight(mode, given, tables), given["mission"] or "the options")
        for line in planning.assumed(given, tables, mission) if mode is not planning.page else []:
            log.info(line)
        mode(given, mission, console)


def _tables(given: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Convert options to tables of a mission file, such as {"wind": {"speed": 7.0}}; UsageError if they conflict."""
    if given["place"]:
        if given["lat"] is not None or given["lon"] is not None:
            raise click.UsageError("give --place, or --lat and --lon, not both.")
        from ..readers.areas import middle_of

        given = given | dict(zip(("lat", "lon"), middle_of(given["place"]), strict=True))
    if given["sun"] and any(given[name] is not None for name in ("lat", "lon", "time")):
        raise click.UsageError("give --sun, or place and time, not both.")
    if given["sun"] and len(given["sun"]) < 2:
        raise click.UsageError("--sun needs zenith angle and azimuth, such as 20.5@270.2.")
    bands = given["bands"] and [b.strip() for b in given["bands"].split(",")]
    tables = {"sun": given["sun"] or {}, "wind": given["wind"] or {}, "sensor": {"bands": bands} if bands else {}}
    for name, place in PLACES.items():
        table, _, key = place.partition(".")
        if given[name] is not None:
            tables.setdefault(table, {})[key] = given[name]
    return {name: values for name, values in tables.items() if values}
