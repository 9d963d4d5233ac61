"""The command `deglint simulate`: make synthetic scenes of the sea with their ground truth."""

import json
import logging
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import click

from . import options
from .options import SETTINGS, ChoiceFromTable, Grouped, heading, parsed, threads
from .remove import size

log = logging.getLogger(__name__)

LEAST_SIDE, MOST_SIDE = 8, 16384  # limits of the side of an image [pixel]


def _size(text: str) -> tuple[int, int]:
    """Parse the size of an image: rows and columns, 8 to 16384 [pixel], from "512" (a square) or "ROWSxCOLUMNS"."""
    rows, columns = (int(part) for part in (text.lower() if "x" in text.lower() else f"{text}x{text}").split("x"))
    if not all(LEAST_SIDE <= side <= MOST_SIDE for side in (rows, columns)):
        raise click.BadParameter(f"a side must be {LEAST_SIDE} to {MOST_SIDE} pixels, got {rows} x {columns}.")
    return rows, columns


def _depths(text: str) -> tuple[float, float]:
    """Parse "LEFT:RIGHT": depths of the bottom [m] at the left and right edge of a scene, or one depth for both."""
    left, _, right = text.partition(":")
    return float(left), float(right or left)


def _boat(text: str) -> tuple[float, ...]:
    """Parse "RIGHT,DOWN,SPEED[@HEADING]" of a boat: place from the upper left [m], speed [m/s], heading [degree]."""
    place, _, heading = text.partition("@")
    right, down, speed = (float(part) for part in place.split(","))
    return right, down, speed, float(heading or 0.0)


SPECTRUM = ChoiceFromTable("WaveSpectrum", "deglint.physics.waves")
SLOPE_LAW = ChoiceFromTable("SlopeModelName", "deglint.simulate.setup")
KERNEL = ChoiceFromTable("Kernel", "deglint.simulate.artefacts")
OBJECTS = click.Choice(["thesis", "none"], case_sensitive=False)
BOAT = "A boat of 8 m: its position [m], speed and heading."
read_size = parsed(_size, "is not a number of pixels, nor ROWSxCOLUMNS.")
read_depths = parsed(_depths, "is not like 25:3, the depth at the left and at the right edge.")
read_boats = parsed(_boat, "is not like 20,35,6@60: RIGHT,DOWN [m], SPEED [m/s] @ HEADING.")
read_foam = parsed(lambda text: None if text == "auto" else float(text), "is neither a share, such as 0.01, nor auto.")


@click.command(cls=Grouped, context_settings=SETTINGS)
@click.argument("out", metavar="OUT", type=click.Path(path_type=Path))
@heading("Sea and light")
@click.option("--wind", type=float, multiple=True, metavar="M/S", help="Wind at 10 m.  [default: 5]")
@click.option("--wind-from", default=30.0, metavar="DEG", help="Azimuth the wind blows from.")
@click.option("--sun-zenith", default=40.0, metavar="DEG", help="Angle of the sun from the zenith.")
@click.option("--sun-azimuth", default=135.0, metavar="DEG", help="Azimuth of the sun.")
@click.option("--chlorophyll", default=0.5, metavar="MG/M3", help="Chlorophyll in the water.")
@click.option("--sky", type=options.SKY_CHOICE, default="cardioidal", help="Model of the sky.")
@click.option("--spectrum", type=SPECTRUM, default="elfouhaily", help="Spectrum of the waves.")
@click.option("--slopes", type=SLOPE_LAW, default="cox-munk", help="Distribution of slopes for the mean glint.")
@click.option("--fetch", default=100e3, metavar="M", help="For jonswap: distance the wind has blown over water.")
@click.option("--patch", default=0.005, metavar="M", help="Size of facets that sparkle; 0: no sparkle.")
@click.option("--seed", default=0, metavar="N", help="Seed: the same gives the same scene.")
@heading("What lies in the water and on it")
@click.option("--objects", type=OBJECTS, default="thesis", help="Squares under water.")
@click.option("--depth", default=5.0, metavar="M", help="Depth of the objects.")
@click.option("--bottom", callback=read_depths, metavar="LEFT:RIGHT", help="Depth of a bottom at either edge [m].")
@click.option("--texture", default=0.4, metavar="SHARE", help="For --bottom: share of patches of algae.")
@click.option("--coast", default=0.0, metavar="M", help="Width of land along the right edge.")
@click.option("--foam", default="0", callback=read_foam, metavar="SHARE|auto", help="Whitecaps; auto: by the wind.")
@click.option("--boat", multiple=True, callback=read_boats, metavar="RIGHT,DOWN,M/S@DEG", help=BOAT)
@heading("Sensor")
@click.option("--preset", "--sensor", "preset", type=options.SENSOR_CHOICE, default="thesis", help="Sensor.")
@click.option("--size", default="512", callback=read_size, metavar="N|ROWSxCOLUMNS", help="Image size [pixel].")
@click.option("--delay", type=float, multiple=True, metavar="S", help="Delay between bands.  [default: the sensor's]")
@click.option("--view-zenith", default=0.0, metavar="DEG", help="Angle of the sensor off nadir.")
@click.option("--view-azimuth", default=0.0, metavar="DEG", help="Azimuth of the sensor, seen from the sea.")
@click.option("--supersample", default=4, metavar="N", help="Facets per pixel, each way.")
@heading("Errors of the image")
@click.option("--misregistration", default=0.0, metavar="PIXELS", help="Largest displacement of a band.")
@click.option("--striping", default=0.0, metavar="%", help="Standard deviation of the columns' gain.")
@click.option("--resampling", type=KERNEL, help="Interpolate the image from another grid.")
@click.option("--jpeg", type=click.IntRange(1, 100), metavar="QUALITY", help="Compress the image as JPEG.")
@heading("Output")
@click.option("--surface", is_flag=True, help="Write height and slopes of the sea, too.")
@click.option("--grid", is_flag=True, help="Simulate all winds, delays, geometries and f-numbers in directory OUT.")
@click.option("--overwrite", is_flag=True, help="Replace files that are there.")
@click.option("--dry-run", is_flag=True, help="Print which scenes would be written, and their sizes, and stop.")
@heading("Processing")
@threads
@heading("Messages")
@click.option("--json", "as_json", is_flag=True, help="Print the names of the files as JSON on stdout.")
@options.messages
def simulate(out: Path, **given: Any) -> None:
    """Simulate an image of the sea: OUT.tif, the ground truth beside it, and OUT.json with all parameters.

    \b
    deglint simulate --preset thesis --wind 9 --delay 0.060 --seed 7 scene
    deglint simulate --bottom 20:2 --coast 8 --foam auto --boat 20,30,6@60 reef
    deglint simulate --grid --size 256 --wind 5 --wind 9 experiments
    """
    from ..raster.simulated import planned_files, write_scene
    from ..raster.targets import check_targets, make_directory
    from ..simulate import simulate as make
    from ..tiles import default_threads
    from .running import Console

    written = []
    setups, workers = _setups(out, given), default_threads(given["threads"])
    planned = [planned_files(name, setup, surface=given["surface"]) for name, setup in setups]
    if given["grid"] and not given["dry_run"]:
        make_directory(out)
    if out.exists() or not given["grid"]:
        check_targets([path for files in planned for path in files], overwrite=given["overwrite"])
    if given["dry_run"]:
        if given["as_json"]:
            click.echo(json.dumps([str(path) for files in planned for path in files]))
            return
        click.echo("\n".join(str(next(iter(files))) for files in planned))  # the images
        total, many = size(sum(sum(files.values()) for files in planned)), "s" * (len(planned) > 1)
        click.echo(f"{len(planned)} scene{many} with the truth, at most {total}. Nothing was written.")
        return
    bands = len(setups[0][1].sensor.bands)
    with Console(given) as console:

        def progress(done: int, _total: int) -> None:
            console.progress("simulate", count * bands + done, len(setups) * bands)

        for count, (name, setup) in enumerate(setups):
            scene = make(setup, workers=workers, keep_surface=given["surface"], progress=progress)
            paths = write_scene(scene, name, overwrite=given["overwrite"])
            written += [str(path) for path in paths]
            log.info("%d of %d: %s, wind %g m/s, seed %d", count + 1, len(setups), paths[0], setup.wind, setup.seed)
    if given["as_json"]:
        click.echo(json.dumps(written))


def _setups(out: Path, given: dict[str, Any]) -> list[tuple[Path, Any]]:
    """Path without ending and `Setup` of each scene; raises UsageError for several winds or delays without --grid."""
    from ..physics.presets import preset
    from ..simulate import Artefacts, Bottom, FloatingTarget, Setup, thesis_array, whitecaps
    from ..simulate.setup import DELAYS, WINDS, experiments

    sensor = preset(given["preset"])
    squares = thesis_array(given["size"], sensor.gsd, depth=given["depth"]) if given["objects"] == "thesis" else ()
    same = given.keys() & {f.name for f in fields(Setup)} - {"bottom", "foam", "misregistration", "objects", "wind"}
    winds, delays = given["wind"], given["delay"]
    wind = winds[0] if winds else 5.0
    base = Setup(
        bottom=Bottom(depth=given["bottom"], share=given["texture"]) if given["bottom"] else None,
        foam=whitecaps(wind) if given["foam"] is None else given["foam"],
        targets=tuple(FloatingTarget(right=x, down=y, speed=v, heading=h, wake=3 * v) for x, y, v, h in given["boat"]),
        artefacts=Artefacts(striping=given["striping"] / 100, resampling=given["resampling"], jpeg=given["jpeg"]),
        sensor=sensor.delayed(delays[0]) if delays else sensor,
        wind=wind,
        objects=squares,
        misregistration=_offsets(given["misregistration"], len(sensor.bands), given["seed"]),
        **{name: given[name] for name in same},
    )
    down, right = (n * sensor.gsd for n in given["size"])
    for boat in base.targets:
        seen = boat.length / 2 + boat.wake  # beyond the edge, a part of the hull or of the wake may be in the scene
        if not (-seen < boat.right < right + seen and -seen < boat.down < down + seen):
            raise click.UsageError(
                f"--boat {boat.right:g},{boat.down:g} is outside the scene: it is {right:g} m wide, {down:g} m high."
            )
    if not given["grid"]:
        if len(winds) > 1 or len(delays) > 1:
            raise click.UsageError("several --wind or --delay make several scenes: give --grid, too.")
        return [(out, base)]
    grid = experiments(base, winds=winds or WINDS, delays=delays or DELAYS)
    auto = given["foam"] is None  # then each scene has the foam of its own wind
    return [(out / name, replace(setup, foam=whitecaps(setup.wind)) if auto else setup) for name, setup in grid]


def _offsets(most: float, count: int, seed: int) -> tuple[tuple[float, float], ...]:
    """Random misregistration (down, right) of `count` bands, up to `most` [pixel], first band 0; () if `most` is 0."""
    import numpy as np

    if not np.isfinite(most):
        return ((most, most),) * count  # which `Setup` refuses
    if most == 0:
        return ()
    drawn = np.random.default_rng([abs(seed), 3]).uniform(-abs(most), abs(most), (count, 2)).round(3)
    return ((0.0, 0.0), *((float(down), float(right)) for down, right in drawn[1:]))
