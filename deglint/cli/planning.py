"""Modes of `deglint plan`: a reticle for one time, a sweep over time, an uncertain wind, a flight line, a web page."""

import logging
import re
from collections.abc import Callable, Mapping
from typing import Any

import click
import numpy as np

from ..physics import sun
from ..plan import swath, sweep
from ..plan.charts import day_picture, line_picture, selected, wind_picture
from ..plan.dataset import summary
from ..plan.draw import Image, png
from ..plan.mission import Mission, Tables
from ..plan.picture import picture
from ..plan.reticle import best_geometry, quality, reticle, sentence
from ..raster.output import as_json
from ..raster.simulated import write_files, write_plan
from .running import Console

log = logging.getLogger(__name__)
PORT = 8765  # default of --port
Options = dict[str, Any]  # options of the command by name
Mode = Callable[[Options, Mission, Console], None]
"""Function of the options, the mission and the console: it computes a plan, writes its files and prints it."""


def mode_of(given: Options) -> Mode:
    """The function of this module that makes the requested plan. Raises a usage error if options conflict."""
    asked = {
        "--from": over_time if given["start"] or given["end"] or given["every"] else None,
        "--wind-within": under_winds if given["wind_within"] else None,
        "--fov": flight_line if given["fov"] else None,
        "--serve": page if given["serve"] else None,
    }
    found = {name: mode for name, mode in asked.items() if mode is not None}
    if len(found) > 1:
        raise click.UsageError(f"{' and '.join(found)} are different plans: ask for one at a time.")
    mode = next(iter(found.values()), one_reticle)
    if mode is over_time and not (given["start"] and given["end"]):
        raise click.UsageError("a sweep over time needs both --from and --to.")
    if mode is over_time and given["time"]:
        raise click.UsageError("give --time, or --from and --to, not both.")
    for name, own in {"--fov": ("altitude", "pitch", "roll"), "--serve": ("port", "no_browser")}.items():
        if asked[name] is None and (idle := [option for option in own if given[option] not in (None, False)]):
            raise click.UsageError(f"--{idle[0].replace('_', '-')} is for {name}: leave it out, or give {name}.")
    if mode is not one_reticle and given["show"]:
        raise click.UsageError(f"--show is not possible with {next(iter(found))}: leave out --show.")
    if mode is page and (given["outs"] or given["as_json"]):
        raise click.UsageError("--serve writes no files: leave -o and --json out.")
    return mode


def by_daylight(mode: Mode, given: Options, tables: Mapping[str, Any]) -> Mapping[str, Any]:
    """Set the time of a mission: in a sweep, that of the highest sun; for a page without a time, the next daylight.

    Returns the tables of the mission file. In other modes, or without latitude or longitude, they are not changed.
    """
    place = dict(own) if isinstance(own := tables.get("place"), Mapping) else {}
    if "latitude" not in place or "longitude" not in place:
        return tables
    if mode is over_time:
        when = np.array(_times(given))
        lowest = np.argmin(sun.position(place["latitude"], place["longitude"], when).zenith)
        place["time"] = f"{when[lowest]}Z"
    elif mode is page and "time" not in place:
        place["time"] = f"{sweep.next_daylight(place['latitude'], place['longitude'])}Z"
        log.info("the page starts at %s, in the next daylight; --time gives another time.", place["time"])
    return {**tables, "place": place}


def _times(given: Options) -> list[np.datetime64]:
    return sweep.times(given["start"], given["end"], given["every"] or 30.0)


def one_reticle(given: Options, mission: Mission, _console: Console) -> None:
    """Make a reticle, the plan of all viewing geometries at one time; write it, and print a summary."""
    found, band = reticle(mission), given["show"]
    if band:
        found.index(band)
    if given["outs"]:
        write_plan(found, given["outs"], lambda: png(picture(found, band=band)), overwrite=given["overwrite"])
    if given["as_json"]:
        click.echo(as_json(summary(found)))
        return
    geometry = best_geometry(found, band=band)
    click.echo(sentence(geometry) + ("" if geometry is None else f"\n{quality(geometry)}"))


def over_time(given: Options, mission: Mission, console: Console) -> None:
    """Make a plan for a span of time: the best time, and the best viewing geometry at each time."""
    when = _times(given)
    moments, found = [], []
    for moment, plan in sweep.plans(mission, when):
        moments.append(moment)
        found.append(plan)
        console.progress("sweep", len(moments), len(when))
    shown = {k: p for k in selected(moments) if (p := found[k]) is not None}
    _finish(given, lambda: day_picture(mission, moments, shown), sweep.numbers(mission, moments), sweep.table(moments))


def under_winds(given: Options, mission: Mission, _console: Console) -> None:
    """Make a plan for an uncertain wind: viewing geometries that no wind of an interval excludes."""
    found = sweep.WindEnsemble(mission, **given["wind_within"])
    _finish(given, lambda: wind_picture(found), found.numbers(), found.words())


def flight_line(given: Options, mission: Mission, _console: Console) -> None:
    """Make a plan for a flight line: the heading with the least glint."""
    across, _, along = given["fov"].lower().partition("x")
    try:
        angles = {"across": float(across), "along": float(along or 0.0)}
    except ValueError:
        raise click.UsageError(f"--fov {given['fov']!r} is not ACROSS or ACROSSxALONG degrees.") from None
    angles |= {name: given[name] for name in ("altitude", "pitch", "roll") if given[name] is not None}
    found = swath.Line(mission, swath.FieldOfView(**angles))
    others = swath.alternatives(mission, found)
    said = swath.words(found, others)
    _finish(given, lambda: line_picture(mission, found, said), swath.numbers(mission, found, others), said)


def page(given: Options, mission: Mission, _console: Console) -> None:
    """Serve a web page with sliders that change the plan, until the user presses Ctrl-C."""
    from ..plan.serve import serve

    port = PORT if given["port"] is None else given["port"]
    serve(mission, port=port, say=log.info, browser=not given["no_browser"])


def assumed(given: Options, tables: Tables, mission: Mission) -> list[str]:
    """Lines for the log: times, time zones and winds that are assumed if none is given, and warnings of the mission."""
    out = [f"time: now, {mission.moment}Z."] if mission.sun_zenith is None and mission.time is None else []
    spans = [given["start"], given["end"]] if given["start"] else [mission.time]
    texts = [str(time).strip() for time in spans if mission.sun_zenith is None and time is not None]
    bare = [text for text in texts if not re.search(r"(Z|[+-]\d\d:?\d\d)$", text, re.IGNORECASE)]
    out += [f"time {text} has no time zone: UTC is assumed." for text in bare]
    wind, way = tables.get("wind", {}), "give --wind SPEED@FROM."
    if "speed" not in wind:
        out.append(f"wind: {mission.wind:g} m/s from {mission.wind_from:g} degrees assumed; {way}")
    elif "from" not in wind:
        out.append(f"wind: from {mission.wind_from:g} degrees assumed; {way}")
    return out + list(mission.cautions)


def _finish(given: Options, picture: Callable[[], Image], numbers: Mapping[str, object], lines: list[str]) -> None:
    """Write `picture` and `numbers` to the output files; print `numbers` as JSON, or the `lines` of text."""
    if given["outs"]:
        outs = {path: png(picture()) if path.suffix.lower() == ".png" else numbers for path in given["outs"]}
        write_files(outs, overwrite=given["overwrite"])
    click.echo(as_json(numbers) if given["as_json"] else "\n".join(lines))
