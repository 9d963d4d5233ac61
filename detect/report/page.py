"""The report as text, and as one HTML page (jinja2, matplotlib) without scripts or external files."""

import math
import os
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.resources import files
from typing import Any

from deglint import __version__
from deglint.checksum import Checksum
from deglint.pipeline.outputs import versions

from . import plots
from .evaluate import Evaluation, Request

MOST_ROWS = 200  # maximum number of objects listed on the page


def render(package: str, **values: Any) -> str:
    """Fill the template `report.html.jinja` of a package, with the style that all pages share."""
    from jinja2 import Environment

    style = files("detect.report").joinpath("style.css").read_text(encoding="utf-8")
    template = files(package).joinpath("report.html.jinja").read_text(encoding="utf-8")
    return Environment(autoescape=True).from_string(template).render(style=style, **values)


def page(found: Evaluation, made: Mapping[str, Any]) -> str:
    """The complete page (HTML); `made` comes from `provenance`."""
    bands, objects = found.detectors[0].bands, found.detectors[0].objects
    drawn = {"roc": plots.as_uri(plots.roc_curves(found)), "precision": plots.as_uri(plots.precision_curves(found))}
    if objects is not None:
        drawn["objects"] = plots.as_uri(plots.object_curves(found))
    places = [
        (d.name, plots.as_uri(plots.scene(d, found), "png"),
         plots.as_uri(plots.chips(d, found), "png") if d.worst else "", f"{d.worst_at.pfa:.3g}")
        for d in found.detectors
    ]  # fmt: skip
    return render(
        "detect.report", found=found, numbers=found.numbers, made=made, lead=lead(found.numbers), plots=drawn,
        interval=interval, level=f"{bands.level:.0%}" if bands else "", places=places,
        objects=None if objects is None else _objects(found),
    )  # fmt: skip


def provenance(request: Request, command: str, seconds: float, checksum: Checksum) -> dict[str, Any]:
    """Versions, machine, command and inputs of a report. Raises ReadError: a file changed while it was read.

    `seconds` is the duration of the evaluation [s]; `checksum` was made before the files were read.
    """
    import cv2
    import scipy

    return {
        "command": command,
        "rxdetect": __version__,
        "versions": versions() | {"scipy": scipy.__version__, "opencv": cv2.__version__},
        "machine": {"system": platform.platform(), "processor": platform.machine(), "processors": os.cpu_count()},
        "seed": request.seed,
        "seconds": round(seconds, 2),
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "inputs": [{k: f[k] for k in ("path", "bytes", "crc32")} for f in checksum.result() if f["bytes"] is not None],
    }


def _objects(found: Evaluation) -> tuple[list[str], list[list[str]]]:
    """Column heads and rows of the table of objects: the smallest Pfa at which each detector finds each object."""
    sign = -1 if found.request.lower else 1
    scored = [{o.number: o for o in d.objects.objects} for d in found.detectors if d.objects is not None]
    order = sorted(scored[0].values(), key=lambda o: (min(s[o.number].pfa for s in scored), o.number))
    rows = []
    for o in order[:MOST_ROWS]:
        (row0, row1), (col0, col1) = o.bounds
        rows.append([str(o.number), str(o.size), f"{(col0 + col1 - 1) / 2:g}, {(row0 + row1 - 1) / 2:g}",
                     *(f"{s[o.number].pfa:.3g} ({sign * s[o.number].score_max:.5g})" for s in scored)])  # fmt: skip
    return ["object", "pixels", "column, row", *(d.name for d in found.detectors)], rows


def lead(numbers: dict[str, Any]) -> str:
    """Summary of the detector with the largest partial AUC, in one sentence; `numbers` as in `Evaluation`."""
    best = max(numbers["detectors"], key=lambda d: d["partial_auc"]["raw"])
    said = f"{best['name']}: a target pixel scores higher than a background pixel with probability {best['auc']:.4f}"
    point = min(best["operating_points"], key=lambda p: abs(math.log(p["pfa_designed"] / 1e-3)), default=None)
    if point is not None:
        rate, share = point["pfa_designed"], point["pd"]
        said += f"; at a false-alarm rate of {rate:g}, {share:.1%} of the target pixels are detected"
        if "objects_found" in point:
            alarms = counted(point["false_alarms"], "false alarm")
            said += f", and {point['objects_found']} of {counted(point['objects'], 'object')} are found with {alarms}"
    return f"{said}."


def table(numbers: dict[str, Any]) -> list[str]:
    """The results (`Evaluation.numbers`) as lines of text for a terminal."""
    pixels = numbers["pixels"]
    judged = f"{pixels['judged']} of {pixels['total']} pixels judged: {pixels['targets']} of targets"
    out = [f"{judged} ({counted(pixels['objects'], 'object')}), {pixels['background']} of background"]
    out += [f"left out: {n} {why}" for why, n in pixels["left_out"].items()]
    rates = [p["pfa_designed"] for p in numbers["detectors"][0]["operating_points"]]
    wide = max(8, *(len(d["name"]) for d in numbers["detectors"]))
    out += ["", f"{'detector':<{wide}}  {'AUC':>7}  {'interval':>15}  {'pAUC':>8}  {'AP':>7}"
            + "".join(f"  {f'Pd@{r:.0e}':>9}" for r in rates)]  # fmt: skip
    for d in numbers["detectors"]:
        span = d["bootstrap"] or d["delong"]
        out.append(
            f"{d['name']:<{wide}}  {d['auc']:>7.4f}  {span['low']:>7.4f}-{span['high']:<7.4f}  "
            f"{d['partial_auc']['raw']:>8.5f}  {d['average_precision']:>7.4f}"
            + "".join(f"  {p['pd']:>9.4f}" for p in d["operating_points"])
        )
    for d in numbers["detectors"]:
        for p in d["operating_points"] if "objects" in d else ():
            per = "" if p["false_alarms_per_km2"] is None else f" ({p['false_alarms_per_km2']:.3g} per km2)"
            out.append(f"{d['name']}: at Pfa {p['pfa']:.2g}, {p['objects_found']} of {p['objects']} objects found, "
                       f"{counted(p['false_alarms'], 'false alarm')}{per}")  # fmt: skip
    for c in numbers["comparisons"]:
        span = "" if c["bootstrap_low"] is None else f" ({c['bootstrap_low']:+.4f} to {c['bootstrap_high']:+.4f})"
        out.append(f"AUC of {c['first']} minus {c['second']}: {c['difference']:+.4f}{span}")
    return out


def counted(n: int, name: str) -> str:
    """Text of a number and a noun, which gets a plural s unless the number is 1."""
    return f"{n:,} {name}{'' if n == 1 else 's'}"


def interval(low: float | None, high: float | None, form: str = ".4f") -> str:
    """Text of a range of numbers; "not known" where an end is None or NaN."""
    if low is None or high is None or math.isnan(low) or math.isnan(high):
        return "not known"
    return f"{low:{form}} to {high:{form}}"
