"""Findings in words, for the page and for the terminal."""

from __future__ import annotations

import math
from typing import Any


def lead(numbers: dict[str, Any]) -> str:
    """The finding in a sentence or two."""
    detectors = numbers["detectors"]
    n = max(detectors, key=lambda d: d["partial_auc"]["raw"])
    point = min(n["operating_points"], key=lambda p: abs(math.log(p["pfa_designed"] / 1e-3)), default=None)
    boot = n["bootstrap"]
    span = f" ({interval(boot['low'], boot['high'])})" if boot else ""
    ranks = f"a target pixel scores higher than a background pixel with probability {n['auc']:.4f}{span}"
    name = n["name"] + (", which does best at low false-alarm rates," if len(detectors) > 1 else "")
    if point is None:
        return f"With {name} {ranks}."
    at = f"At a false-alarm rate of {point['pfa_designed']:g} {name}"
    share = f"{100 * point['pd']:.3g} % of the target pixels"
    if "objects_found" not in point:
        return f"{at} detects {share}; {ranks}."
    alarms = counted(point["false_alarms"], "false alarm")
    if point["false_alarms_per_km2"] is not None:
        alarms += f" ({point['false_alarms_per_km2']:.4g} per km²)"
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


def counted(n: int, name: str) -> str:
    """A number and what it counts."""
    return f"{n:,} {name}{'' if n == 1 else 's'}"


def interval(low: float | None, high: float | None, form: str = ".4f") -> str:
    """A range of numbers."""
    if low is None or high is None or math.isnan(low) or math.isnan(high):
        return "not known"
    return f"{low:{form}} to {high:{form}}"
