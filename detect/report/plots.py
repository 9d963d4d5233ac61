"""Figures of the report by matplotlib: curves, and pictures of the scores."""

from __future__ import annotations

import io
from base64 import b64encode
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from deglint.errors import InputError

from ..arrays import Array, Mask
from .evaluate import Evaluation, Judged

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LONGEST = 640  # longest side of a scene as it is shown [pixel]
_CUTOUT_MARGIN = 12  # margin around a false alarm [pixel]


def check_installed(command: str) -> None:
    """Check that matplotlib and jinja2 are installed for a command. Raises InputError: one is missing."""
    missing = [name for name in ("matplotlib", "jinja2") if find_spec(name) is None]
    if missing:
        raise InputError(f"{command} needs {' and '.join(missing)}: pip install 'deglint[reports]'.")


def as_uri(figure: Figure, form: str = "svg") -> str:
    """Convert a figure to a data URI; `form` is "svg" or "png"."""
    import matplotlib as mpl

    file = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "deglint", "svg.fonttype": "none"}):
        figure.savefig(file, format=form, bbox_inches="tight", metadata={"Date": None} if form == "svg" else None)
    return f"data:image/{form.replace('svg', 'svg+xml')};base64," + b64encode(file.getvalue()).decode()


def new_figure(width: float, height: float) -> Figure:
    """New figure of a width and a height [inch]; it needs no window and no global state of matplotlib."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def roc_curves(found: Evaluation) -> Figure:
    """Plot Pd over Pfa of all detectors, with bootstrap intervals and operating points."""
    figure = new_figure(9.0, 4.4)
    ax = figure.subplots()
    low = 1 / max(len(d.roc.background) for d in found.detectors)
    grid = np.geomspace(low, 1, 200)
    ax.plot(grid, grid, ":", color="0.5")
    for d in found.detectors:
        pfa, pd = d.roc.vertices
        at = np.sort(np.concatenate([grid, pfa[pfa >= low]]))
        (line,) = ax.plot(at, np.interp(at, pfa, pd), label=d.name)
        points = d.numbers["operating_points"]
        ax.plot([p["pfa_designed"] for p in points], [p["pd"] for p in points], "o", fillstyle="none",
                color=line.get_color())  # fmt: skip
        if d.bands is not None:
            ax.fill_between(d.bands.pfa, d.bands.low, d.bands.high, alpha=0.15, color=line.get_color(), linewidth=0)
    ax.set(xscale="log", xlim=(low, 1), ylim=(0, 1.02), xlabel="Pfa: background pixels detected",
           ylabel="Pd: target pixels detected")  # fmt: skip
    ax.legend()
    return figure


def precision_curves(found: Evaluation) -> Figure:
    """Plot precision over recall (Pd) of all detectors."""
    figure = new_figure(5.0, 3.6)
    ax = figure.subplots()
    for d in found.detectors:
        precision, recall = d.roc.precision_recall
        ax.plot(recall, precision, label=d.name)
    ax.set(xlim=(0, 1), ylim=(0, 1.02), xlabel="Pd (recall)", ylabel="precision")
    return figure


def object_curves(found: Evaluation) -> Figure:
    """Plot the fraction of objects found over the number of false alarms, of all detectors."""
    figure = new_figure(5.0, 3.6)
    ax = figure.subplots()
    for d in found.detectors:
        if d.objects is not None:
            # false alarms may merge as the threshold falls
            cost = np.minimum.accumulate(d.objects.false_alarms[::-1])[::-1]
            ax.step(np.maximum(cost, 0.5), d.objects.pd, where="post", label=d.name)
    ax.set(xscale="log", ylim=(0, 1.02), xlabel="false alarms in the scene (none is drawn at 0.5)",
           ylabel="objects found")  # fmt: skip
    return figure


def shrink(scores: Array, valid: Mask) -> tuple[Array, int]:
    """Reduce scores, (row, column), for display: the maximum of each square cell; and the side of a cell [pixel].

    With the maximum, small targets remain visible. NaN where no score of a cell is valid.
    """
    from skimage.measure import block_reduce

    step = max(1, -(-max(scores.shape) // _LONGEST))
    seen = block_reduce(np.where(valid, scores, -np.inf), step, np.max, cval=-np.inf)
    return np.where(np.isneginf(seen), np.nan, seen), step


def scene(d: Judged, found: Evaluation) -> Figure:
    """Plot the scores of a scene, its objects in boxes (dashed: not found), and false alarms with their numbers."""
    from matplotlib.patches import Rectangle

    height, width = d.scores.shape
    figure = new_figure(7.0, min(7.0 * height / width, 14.0) + 0.3)
    ax = figure.subplots()
    seen, step = shrink(d.scores, found.inputs.valid)
    extent = (0, seen.shape[1] * step, seen.shape[0] * step, 0)
    low, high = np.nanpercentile(seen, [50, 99.9])
    picture = ax.imshow(seen, cmap="cividis", vmin=low, vmax=high, extent=extent, interpolation="nearest")
    sign = -1 if found.request.lower else 1
    figure.colorbar(picture, ax=ax, shrink=0.6, format=lambda value, _place: f"{sign * value:.4g}")
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
    """Plot the scores around each of the worst false alarms, with the number and the maximum score as title."""
    figure = new_figure(5.0, 1.7 * -(-len(d.worst) // 3))
    low, high = np.percentile(d.scores[found.inputs.valid], [50, 99.9])
    for number, (alarm, said) in enumerate(zip(d.worst, d.numbers["worst_false_alarms"], strict=True), start=1):
        ax = figure.add_subplot(-(-len(d.worst) // 3), 3, number)
        around = tuple(slice(max(first - _CUTOUT_MARGIN, 0), last + _CUTOUT_MARGIN) for first, last in alarm.bounds)
        seen = np.where(found.inputs.valid[around], d.scores[around], np.nan)
        ax.imshow(seen, cmap="cividis", vmin=low, vmax=high, interpolation="nearest")
        ax.set(xticks=[], yticks=[])
        ax.set_title(f"{number}: {said['score_max']:.4g}", fontsize=9)
    return figure
