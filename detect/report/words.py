"""Numbers and findings in words, for the page and for the terminal."""

from __future__ import annotations

import math
from html import escape
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .evaluate import Evaluation

MOST_ROWS = 200
"""Objects listed on the page."""

READING = """
<h2>How to read this</h2>
<p><b>Pd</b> is the fraction of target pixels that are detected, <b>Pfa</b> that of background pixels: a pixel is
detected when its score is above the threshold. <b>AUC</b> is the chance that a target pixel scores higher than a
background pixel. It is ruled by Pfa nobody can work at; look at the left of the curve, at the partial area, and at Pd
for the Pfa you can afford. <b>McClish</b> brings the partial area to 0.5 for chance and 1 for perfection.
<b>Average precision</b> falls as targets become rarer: compare it within a scene only.</p>
<p><b>RX</b> asks how unusual a pixel is for its background. It takes the mean and the covariance of the bands over the
background: a whole scene, or the surroundings of the pixel. The score is the squared distance of the pixel from the
mean, measured in standard deviations along each direction in which the bands vary together. A high score says that the
pixel is an anomaly, not that it is a target: whitecaps, clouds and glint are anomalies, too.</p>
<p><b>Intervals.</b> Neighbouring pixels are not independent: pixels of one object are found or missed together, and
clutter comes in patches. Intervals that count pixels (DeLong's) promise too much. The bootstrap draws whole objects,
and square blocks of background, with replacement; it answers how far the figures would move with other objects and
other background <em>of the same kind in the same scene</em>. It knows nothing of other days, and with fewer than
about ten objects it is too narrow as well.</p>
"""


def lead(found: Evaluation) -> str:
    """The finding in a sentence or two, as HTML."""
    best = max(found.detectors, key=lambda d: d.numbers["partial_auc"]["raw"])
    n = best.numbers
    points = n["operating_points"]
    point = min(points, key=lambda p: abs(math.log(p["pfa_designed"] / 1e-3)), default=None)
    boot = n["bootstrap"]
    span = f" ({interval(boot['low'], boot['high'])})" if boot else ""
    ranks = f"a target pixel scores higher than a background pixel with probability {n['auc']:.4f}{span}"
    name = f"<b>{escape(best.name)}</b>"
    if len(found.detectors) > 1:
        name += ", which does best at low false-alarm rates,"
    if point is None:
        return f"With {name} {ranks}."
    at = f"At a false-alarm rate of {rate(point['pfa_designed'])} {name}"
    share = f"{percent(point['pd'])} of the target pixels"
    if "objects_found" not in point:
        return f"{at} detects {share}; {ranks}."
    alarms = counted(point["false_alarms"], "false alarm")
    if point["false_alarms_per_km2"] is not None:
        alarms += f" ({short(point['false_alarms_per_km2'])} per km²)"
    return (
        f"{at} finds {point['objects_found']} of {counted(point['objects'], 'object')}, with {alarms} in the scene. It "
        f"detects {share}; {ranks}."
    )


def table(numbers: dict[str, Any]) -> list[str]:
    """The findings as lines of a terminal."""
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
        out.append(f"AUC of {c['first']} less {c['second']}: {c['difference']:+.4f}{span}")
    return out


def counted(n: int, noun: str) -> str:
    """A number with a noun, in the plural where needed."""
    return f"{n:,} {noun}{'' if n == 1 else 's'}"


def sentence(text: str) -> str:
    """With a capital and a full stop."""
    return text[:1].upper() + text[1:] + ("" if text.endswith(".") else ".")


def percent(value: float) -> str:
    """A fraction in percent."""
    return f"{100 * value:.3g} %"


def interval(low: float | None, high: float | None, form: str = ".4f") -> str:
    """A range of numbers."""
    if low is None or high is None or math.isnan(low) or math.isnan(high):
        return "not known"
    between = " to " if form[0] == "+" else "&thinsp;&ndash;&thinsp;"
    return f"{low:{form}}{between}{high:{form}}".replace("-", "&minus;")


def signed(value: float) -> str:
    """A difference."""
    return f"{value:+.4f}".replace("-", "&minus;")


def short(value: float) -> str:
    """A number with four digits at most."""
    if not math.isfinite(value):
        return "&infin;" if value > 0 else "&ndash;"
    if value != 0 and (abs(value) < 1e-3 or abs(value) >= 1e6):
        return rate(value)
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"


def rate(value: float) -> str:
    """A small number such as a Pfa, as HTML: 2.1 x 10^-4."""
    if value == 0 or 1e-2 <= abs(value) < 1e4:
        return f"{value:.3g}"
    digits, power = f"{value:.2e}".split("e")
    if -2 <= int(power) < 4:  # by rounding
        return f"{float(f'{value:.2e}'):g}"
    digits = digits.rstrip("0").rstrip(".")
    shown = "" if digits == "1" else f"{digits}&thinsp;&times;&thinsp;"
    return f"{shown}10<sup>{'&minus;' if int(power) < 0 else ''}{abs(int(power))}</sup>"


def p_value(p: float) -> str:
    """A p-value, none smaller than 0.0001."""
    if math.isnan(p):
        return "not known"
    return "&lt; 0.0001" if p < 1e-4 else f"{p:.4f}"
