"""The report of `rxdetect roc` as text, and as one HTML page (jinja2, matplotlib) without scripts or other files."""

from __future__ import annotations

import io
import os
import platform
from base64 import b64encode
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.resources import files
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from deglint import __version__
from deglint.checksum import Checksum
from deglint.errors import InputError
from deglint.pipeline.outputs import versions

from ..arrays import Array, Mask
from ..roc.per_object import ObjectScore
from .evaluate import Evaluation, Judged, Request

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST_ROWS = 200  # maximum number of objects listed on the page
_LONGEST = 640  # longest side of a scene as it is shown [pixel]
_CUTOUT_MARGIN = 12  # margin around a false alarm [pixel]


def render(package: str, **values: object) -> str:
    """Fill the HTML template `report.html.jinja` of a package with `values`, and with the style that pages share."""
    from jinja2 import Environment

    style = files("detect.report").joinpath("style.css").read_text(encoding="utf-8")
    template = files(package).joinpath("report.html.jinja").read_text(encoding="utf-8")
    return Environment(autoescape=True).from_string(template).render(style=style, **values)


def page(found: Evaluation, made: Mapping[str, object]) -> str:
    """The complete report (HTML) of an evaluation; `made` comes from `provenance`."""
    functions = {f.__name__: f for f in (counted, as_uri, roc_curves, precision_curves, object_curves, scene, chips)}
    objects = _objects(found)
    return render("detect.report", found=found, numbers=found.numbers, made=made, objects=objects, **functions)


def provenance(request: Request, command: str, seconds: float, checksum: Checksum) -> dict[str, object]:
    """Versions, machine, command and inputs of a report. Raises ReadError if a file changed while it was read.

    `seconds` is the duration of the evaluation [s]; `checksum` was made before the files were read.
    """
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


def _objects(found: Evaluation) -> list[list[ObjectScore]]:
    """Table of at most 200 objects, lowest Pfa first; each row has the scores of one object, one for each detector."""
    scored = [{o.number: o for o in d.objects.objects} for d in found.detectors if d.objects is not None]
    rows = [[s[number] for s in scored] for number in (scored[0] if scored else ())]
    return sorted(rows, key=lambda row: (min(o.pfa for o in row), row[0].number))[:_MOST_ROWS]


def table(numbers: dict[str, Any]) -> list[str]:
    """The results (`Evaluation.numbers`) as lines of text for a terminal."""
    pixels = numbers["pixels"]
    judged = f"{pixels['judged']} of {pixels['total']} pixels judged: {pixels['targets']} of targets"
    out = [f"{judged} ({counted(pixels['objects'], 'object')}), {pixels['background']} of background"]
    out += [f"left out: {n} {why}" for why, n in pixels["left_out"].items()]
    rates = [p["pfa_requested"] for p in numbers["detectors"][0]["operating_points"]]
    wide = max(8, *(len(d["name"]) for d in numbers["detectors"]))
    heads = f"{'detector':<{wide}}  {'AUC':>7}  {'interval':>15}  {'pAUC':>8}  {'AP':>7}"
    out += ["", heads + "".join(f"  {f'Pd@{r:.0e}':>9}" for r in rates)]
    for d in numbers["detectors"]:
        span = d["bootstrap"] or d["delong"]
        interval = "not known" if span["low"] is None else f"{span['low']:.4f}-{span['high']:<7.4f}"
        areas = f"{d['auc']:>7.4f}  {interval:>15}  {d['partial_auc']['raw']:>8.5f}  {d['average_precision']:>7.4f}"
        out.append(f"{d['name']:<{wide}}  {areas}" + "".join(f"  {p['pd']:>9.4f}" for p in d["operating_points"]))
    for d in numbers["detectors"]:
        for p in d["operating_points"] if "objects" in d else ():
            per = "" if p["false_alarms_per_km2"] is None else f" ({p['false_alarms_per_km2']:.3g} per km2)"
            objects = f"{p['objects_found']} of {p['objects']} objects found"
            alarms = f"{counted(p['false_alarms'], 'false alarm')}{per}"
            out.append(f"{d['name']}: at Pfa {p['pfa']:.2g}, {objects}, {alarms}")
    for c in numbers["comparisons"]:
        span = "" if c["bootstrap_low"] is None else f" ({c['bootstrap_low']:+.4f} to {c['bootstrap_high']:+.4f})"
        out.append(f"AUC of {c['first']} minus {c['second']}: {c['difference']:+.4f}{span}")
    return out


def counted(n: int, name: str) -> str:
    """Text of a number and the noun `name`, with a plural s unless the number is 1."""
    return f"{n:,} {name}{'' if n == 1 else 's'}"


def check_installed(command: str) -> None:
    """Check that matplotlib and jinja2 are installed, for `command`. Raises InputError if one is missing."""
    if missing := [name for name in ("matplotlib", "jinja2") if find_spec(name) is None]:
        raise InputError(f"{command} needs {' and '.join(missing)}: pip install 'deglint[reports]'.")


def as_uri(figure: Figure, form: str = "svg") -> str:
    """Convert a matplotlib figure to a data URI for HTML, in the format `form`: "svg" or "png"."""
    import matplotlib as mpl

    file = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "deglint", "svg.fonttype": "none"}):
        figure.savefig(file, format=form, bbox_inches="tight", metadata={"Date": None} if form == "svg" else None)
    return f"data:image/{form.replace('svg', 'svg+xml')};base64," + b64encode(file.getvalue()).decode()


def new_figure(width: float, height: float, panels: int = 1) -> tuple[Figure, list[Axes]]:
    """New matplotlib figure of `width` x `height` [inch], made without pyplot, and its `panels` axes, side by side."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, list(figure.subplots(1, panels, sharey=True, squeeze=False)[0]) if panels else []


def roc_curves(found: Evaluation) -> Figure:
    """Plot Pd over Pfa of all detectors, with bootstrap intervals and operating points."""
    figure, (ax,) = new_figure(9.0, 4.4)
    low = 1 / max(len(d.roc.background) for d in found.detectors)
    grid = np.geomspace(low, 1, 200)
    ax.plot(grid, grid, ":", color="0.5")
    for d in found.detectors:
        pfa, pd = d.roc.vertices
        at = np.sort(np.concatenate([grid, pfa[pfa >= low]]))
        (line,) = ax.plot(at, np.interp(at, pfa, pd), label=d.name)
        points = [(p["pfa_requested"], p["pd"]) for p in d.numbers["operating_points"]]
        ax.plot(*np.reshape(points, (-1, 2)).T, "o", fillstyle="none", color=line.get_color())
        if d.bands is not None:
            ax.fill_between(d.bands.pfa, d.bands.low, d.bands.high, alpha=0.15, color=line.get_color(), linewidth=0)
    ax.set(xscale="log", xlim=(low, 1), ylim=(0, 1.02))
    ax.set(xlabel="Pfa: background pixels detected", ylabel="Pd: target pixels detected")
    ax.legend()
    return figure


def precision_curves(found: Evaluation) -> Figure:
    """Plot precision over recall (Pd) of all detectors."""
    figure, (ax,) = new_figure(5.0, 3.6)
    for d in found.detectors:
        precision, recall = d.roc.precision_recall
        ax.plot(recall, precision, label=d.name)
    ax.set(xlim=(0, 1), ylim=(0, 1.02), xlabel="Pd (recall)", ylabel="precision")
    return figure


def object_curves(found: Evaluation) -> Figure:
    """Plot the fraction of objects found over the number of false alarms, of all detectors."""
    figure, (ax,) = new_figure(5.0, 3.6)
    for d in found.detectors:
        if d.objects is not None:
            # false alarms may merge as the threshold falls: draw the lowest number at this or a lower threshold
            cost = np.minimum.accumulate(d.objects.false_alarms[::-1])[::-1]
            ax.step(np.maximum(cost, 0.5), d.objects.pd, where="post", label=d.name)
    ax.set(xscale="log", xlabel="false alarms in the scene (none is drawn at 0.5)")
    ax.set(ylim=(0, 1.02), ylabel="objects found")
    return figure


def shrink(scores: Array, valid: Mask) -> tuple[Array, int]:
    """Reduce scores, (row, column), to the maximum of each square block; return maxima and side of a block [pixel].

    With the maximum, small targets remain visible. A block without a `valid` score is NaN.
    """
    from skimage.measure import block_reduce

    step = max(1, -(-max(scores.shape) // _LONGEST))
    seen = block_reduce(np.where(valid, scores, -np.inf), step, np.max, cval=-np.inf)
    return np.where(np.isneginf(seen), np.nan, seen), step


def scene(d: Judged, found: Evaluation) -> Figure:
    """Plot a detector's scores, its worst false alarms, and boxes of objects (dashed: missed at `d.worst_at`)."""
    from matplotlib.patches import Rectangle

    height, width = d.scores.shape
    figure, (ax,) = new_figure(7.0, min(7.0 * height / width, 14.0) + 0.3)
    seen, step = shrink(d.scores, found.inputs.valid)
    extent = (0, seen.shape[1] * step, seen.shape[0] * step, 0)
    low, high = np.nanpercentile(seen, [50, 99.9])
    picture = ax.imshow(seen, cmap="cividis", vmin=low, vmax=high, extent=extent, interpolation="nearest")
    figure.colorbar(picture, ax=ax, shrink=0.6, format=lambda value, _place: f"{found.request.sign * value:.4g}")
    for target in () if d.objects is None else d.objects.objects:
        (top, bottom), (left, right) = target.bounds
        style = "-" if target.score_max > d.worst_at.threshold else "--"
        ax.add_patch(Rectangle((left, top), right - left, bottom - top, fill=False, edgecolor="w", linestyle=style))
    for number, alarm in enumerate(d.worst, start=1):
        row, column = alarm.centroid
        ax.plot(column + 0.5, row + 0.5, "o", fillstyle="none", markersize=10, color="#ff8c42")
        ax.annotate(str(number), (column, row), xytext=(6, 6), textcoords="offset points", color="#ff8c42")
    ax.set(xlim=(0, width), ylim=(height, 0))
    return figure


def chips(d: Judged, found: Evaluation) -> Figure:
    """Plot the scores of a detector around each of its worst false alarms, with number and score as title."""
    figure, _none = new_figure(5.0, 1.7 * -(-len(d.worst) // 3), panels=0)
    low, high = np.percentile(d.scores[found.inputs.valid], [50, 99.9])
    for number, (alarm, said) in enumerate(zip(d.worst, d.numbers["worst_false_alarms"], strict=True), start=1):
        ax = figure.add_subplot(-(-len(d.worst) // 3), 3, number)
        around = tuple(slice(max(first - _CUTOUT_MARGIN, 0), last + _CUTOUT_MARGIN) for first, last in alarm.bounds)
        seen = np.where(found.inputs.valid[around], d.scores[around], np.nan)
        ax.imshow(seen, cmap="cividis", vmin=low, vmax=high, interpolation="nearest")
        ax.set(xticks=[], yticks=[])
        ax.set_title(f"{number}: {said['score_max']:.4g}", fontsize=9)
    return figure
