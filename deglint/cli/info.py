"""The command `deglint info`: print the properties of a raster, and the expected error of each candidate recipe."""

import logging
from typing import Any

import click

from .options import FILE, SETTINGS, Grouped, heading, messages, opening, place, reading, threads
from .running import Console


@click.command(cls=Grouped, context_settings=SETTINGS)
@click.argument("inputs", nargs=-1, required=True, type=FILE, metavar="IN [IN ...]")
@heading("What to do")
@place("--sample", "auto|all|FILE.geojson|WINDOW", "Water to judge by; auto: all open water.")
@reading
@heading("Processing")
@threads
@heading("Messages")
@click.option("--json", "as_json", is_flag=True, help="Print JSON on stdout, and nothing else.")
@messages
def info(inputs: tuple[str, ...], sample: str, **given: Any) -> None:
    """Describe IN, and try the candidate recipes on sample tiles; nothing is written.

    \b
    deglint info scene.tif
    deglint info S2B_MSIL1C_20260621.SAFE --json
    """
    from ..info import examine
    from ..pipeline import Recipe
    from ..raster.environment import environment
    from ..raster.output import as_json, plain
    from ..readers import open_scene

    with Console(given, logging.WARNING), environment():  # the answer itself says what was decided
        scene = open_scene(list(inputs), **opening(given))
        found = plain(examine(scene, Recipe(nir=given["nir"], sample=sample), threads=given["threads"]))
    click.echo(as_json(found) if given["as_json"] else "\n".join(lines(found)))


def lines(found: dict[str, Any]) -> list[str]:
    """Convert the result of `deglint.examine` to lines of text."""
    count = len(found["bands"])
    size = f"{found['width']} x {found['height']} pixels, {count} band{'s' * (count != 1)}, {found['dtype']}"
    pixel = "" if found["pixel_size"] is None else ", {:.4g} x {:.4g} m on the ground".format(*found["pixel_size"])
    out = [
        f"{found['path']}  ({found['driver']})",
        f"{size}, nodata {found['nodata']}",
        f"{found['crs'] or 'no CRS'}{pixel}" + (f", sensor {found['sensor']}" if found["sensor"] else ""),
        *(f"  {note}" for note in found["opened"]),
        "",
        f"{'band':<6}{'name':<14}{'wavelength':>12}{'delay':>10}{'R2 with NIR':>14}{'slope':>10}",
    ]
    for i, band in enumerate(found["bands"], start=1):
        wave = "?" if band["wavelength"] is None else f"{band['wavelength']:g} nm"
        offset = "?" if band["time_offset"] is None else f"{band['time_offset']:.3f} s"
        r2, slope = ((found[k] or {}).get(band["name"]) for k in ("r2", "slopes"))
        role = "NIR" if found["nir"] and band["name"] in found["nir"] else ""
        shared = role if r2 is None else f"{r2:.3f}"
        fitted = "" if slope is None else f"{slope:.4f}"
        out.append(f"{i:<6}{band['name']:<14}{wave:>12}{offset:>10}{shared:>14}{fitted:>10}")
    out.append("")
    shares = (("valid", found["valid_fraction"]), ("water", found["water_fraction"]))
    out += [f"{text:<18}{share:.1%}" for text, share in shares if share is not None]
    if found["glint_level"] is not None:
        out.append(f"{'median glint':<18}{found['glint_level']:.4g} (of the sample, in the unit of the NIR)")
    out.append(f"{'suggested recipe':<18}{found['suggested_method'] or 'none'}: {found['reason']}")
    said = {*found["opened"], *found["tried"], found["reason"]}
    return [*out, "", *(note for note in found["notes"] if note not in said), *found["tried"]]
