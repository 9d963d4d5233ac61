"""`rxdetect bench compare`: what got better or worse from one benchmark to another."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from ..bench.compare import Change, Comparison
    from ..bench.section import Number


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("old", metavar="OLD.json")
@click.argument("new", metavar="NEW.json")
@click.option("--fail-on", type=click.Choice(["worse", "changed"]), help="Exit code 1 where something got worse or "
              "slower, or is gone; or where anything that was there changed.")  # fmt: skip
@click.option("--most", type=click.IntRange(0), default=20, show_default=True, metavar="N",
              help="Lines of each kind; 0: all.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print all of it as JSON on stdout, and nothing else there.")
@click.option("-v", "--verbose", count=True, help="-vv: a traceback where it fails.")
def compare(old: str, new: str, **given: Any) -> None:
    """Say what got faster, slower, better or worse beyond noise, what else changed, what is new, and what is gone.

    OLD.json and NEW.json are what rxdetect bench wrote. A mean over seeds counts as better or worse when its interval
    does not overlap the old one; a time when its range does not, and it moved by more than 10 %. Numbers that are the
    same on any machine have changed when they moved beyond rounding. Exit code 0, but for --fail-on.

    \b
    rxdetect bench compare main.json branch.json --fail-on worse
    """  # fmt: skip
    from dataclasses import asdict

    from deglint.raster.output import plain

    from ..bench import compare as room

    found = room.compare(
        *(room.Run.of(path, _read(path, said)) for path, said in ((old, "OLD.json"), (new, "NEW.json")))
    )
    if given["as_json"]:
        click.echo(json.dumps(plain(asdict(found)), indent=2))
    else:
        for line in lines(found, given["most"]):
            click.echo(line)
    if given["fail_on"] and found.fails(given["fail_on"]):
        raise click.exceptions.Exit(1)


def _read(path: str, said: str) -> Any:
    """What a JSON file holds."""
    from deglint.errors import InputError
    from deglint.readers.text import read_text

    try:
        return json.loads(read_text(path, said))
    except (ValueError, RecursionError) as error:  # numbers of thousands of digits are no JSONDecodeError
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path} ({said}) is not JSON: {error}. Give the file that rxdetect bench wrote.") from error


def lines(found: Comparison, most: int) -> list[str]:
    """All of it as lines of a terminal; at most so many of a kind, 0 for all."""
    from ..bench.compare import SHOWN

    out = list(found.notes)
    for verdict in SHOWN:
        own = [c for c in found.changes if c.verdict == verdict]
        if not own:
            continue
        shown = own[: most or None]
        wide = max(len(c.name) for c in shown)
        out += ["", f"{verdict}: {len(own)}", *(f"  {c.name:<{wide}}  {_change(c)}" for c in shown)]
        if len(own) > len(shown):
            out.append(f"  ... and {len(own) - len(shown)} more (--most 0 shows all)")
    counts = ", ".join(f"{found.counts[v]} {v}" for v in SHOWN if found.counts[v])
    total = sum(found.counts.values())
    aside = f", {found.counts['left out']} left out" if found.counts["left out"] else ""
    return [
        *out,
        "",
        f"{total} numbers: {counts or 'nothing changed'}; {found.counts['same']} the same within noise{aside}",
    ]


def _change(change: Change) -> str:
    """From what to what, and by how much."""
    old, new = change.old, change.new
    if old is None or new is None:
        return _said(new if old is None else old)
    return f"{_said(old)} -> {_said(new)}  {_by(old.value, new.value)}".rstrip()


def _said(number: Number | None) -> str:
    if number is None or math.isnan(number.value):
        return "not known"
    return f"{number} {number.unit}".rstrip()


def _by(old: float, new: float) -> str:
    """A change in percent, or as a factor where it is large."""
    if math.isnan(old) or math.isnan(new) or old == 0 or old * new < 0:
        return ""
    ratio = new / old
    return f"x {ratio:.3g}" if ratio >= 2 or ratio <= 0.5 else f"{100 * (ratio - 1):+.2g} %"
