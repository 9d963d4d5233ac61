"""Charts: the contrast over a day, the glint of flight lines by heading, and a plan under an uncertain wind."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from . import draw
from .draw import BLUE, GREY, INK, MAGENTA, ORANGE, PALE, YELLOW, Canvas, Image, Point, around, polar
from .mission import SUN_LIMIT, Mission
from .picture import Caption, conditions, layers, page, place_words, sky_disc, star
from .reticle import Reticle, sentence
from .swath import Line
from .sweep import Moment, WindEnsemble, best_moment

WIDTH = 1240  # width of the pictures [pixel]
_SUNNY = (150, 110, 0)  # colour of labels of the sun (red, green, blue)
_DAY_BOX = 96.0, 140.0, 1090.0, 200.0  # left, top, width and height of the diagram of a day [pixel]
_SMALL = 88  # radius of the small reticles [pixel]
_ROW = 6  # number of small reticles in a row


def day_picture(mission: Mission, moments: Sequence[Moment], plans: dict[int, Reticle]) -> Image:
    """Draw contrast and share of excluded viewing geometries over time and, below, a small disc for each reticle.

    `moments` are the summaries of all times. `plans` maps indices in `moments`, usually from `selected`, to reticles.
    """
    rows = -(-len(plans) // _ROW)
    canvas = Canvas(WIDTH, 440 + rows * (2 * _SMALL + 74))
    best = best_moment(moments)
    canvas.text((40, 22), "When to fly", 26)
    said = place_words(mission), str(moments[0].time)[:10], conditions(mission)[-1]
    canvas.text((40, 60), "   ".join(said), 15, GREY)
    if best is None or best.geometry is None:
        canvas.text((40, 84), "No viewing geometry is good at any of these times.", 20)
    else:
        canvas.text((40, 84), f"Best at {str(best.time)[11:16]} UTC. {sentence(best.geometry)}", 20)
    _over_time(canvas, moments, best)
    for n, (k, plan) in enumerate(plans.items()):
        centre = (40 + _SMALL + 20 + (n % _ROW) * 196.0, 424 + _SMALL + 28 + (n // _ROW) * (2 * _SMALL + 74.0))
        _small(canvas, centre, plan, moments[k], moments[k] is best)
    return canvas.finished()


def selected(moments: Sequence[Moment]) -> list[int]:
    """Select at most 12 evenly spaced times with the sun up, including the best; return their indices in `moments`."""
    up = [k for k, m in enumerate(moments) if m.sun_zenith <= SUN_LIMIT]
    best = best_moment(moments)
    picked = {up[round(float(x))] for x in np.linspace(0, len(up) - 1, min(len(up), 2 * _ROW))}
    if best is not None:
        k = moments.index(best)
        picked = picked - {min(picked, key=lambda i: abs(i - k))} | {k}
    return sorted(picked)


def _over_time(canvas: Canvas, moments: Sequence[Moment], best: Moment | None) -> None:
    """Draw contrast and solar elevation over time as lines, shares of excluded geometries as bars, a star at `best`."""
    left, top, width, height = _DAY_BOX
    count = max(len(moments) - 1, 1)
    high = max((m.geometry.contrast for m in moments if m.geometry), default=1.0)
    half, every = 0.5 * width / count, max(1, -(-len(moments) // 13))

    def at(k: int, share: float) -> Point:
        return left + width * k / count, top + height * (1.0 - share)

    for k, m in enumerate(moments):
        x, y = at(k, m.excluded_share)
        start, end = max(x - half, left), min(x + half, left + width)
        canvas.box(start, y, end - start, top + height - y, (246, 226, 208))
        if k % every == 0:
            canvas.line([(x, top + height), (x, top + height + 6)], INK, 1)
            canvas.text((x, top + height + 18), str(m.time)[11:16], 13, INK, anchor="mm")
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        _, y = at(0, share)
        canvas.line([(left, y), (left + width, y)], PALE, 1)
        canvas.text((left - 8, y), f"{high * share:.0f}", 13, INK, anchor="rm")
        canvas.text((left + width + 8, y), f"{100 * share:.0f} %", 13, ORANGE, anchor="lm")
    canvas.text((left - 56, top - 16), "contrast, x noise", 13, INK, anchor="lm")
    canvas.text((left + width + 46, top - 16), "excluded", 13, ORANGE, anchor="rm")
    sun = [at(k, max(90.0 - m.sun_zenith, 0.0) / 90.0) for k, m in enumerate(moments)]
    canvas.line(sun, YELLOW, 2)
    peak = int(np.argmin([m.sun_zenith for m in moments]))
    high_sun = f"sun {90 - moments[peak].sun_zenith:.0f}°"
    canvas.text((sun[peak][0], sun[peak][1] - 10), high_sun, 13, _SUNNY, anchor="mm", halo=True)
    for _, part in groupby(enumerate(moments), key=lambda item: item[1].geometry is None):
        run = [at(k, m.geometry.contrast / high) for k, m in part if m.geometry is not None]
        if len(run) > 1:
            canvas.line(run, BLUE, 3)
        elif run:
            canvas.circle(run[0], 3, BLUE, -1)
    if best is not None and best.geometry is not None:
        star(canvas, at(moments.index(best), best.geometry.contrast / high), 11.0)


def _small(canvas: Canvas, centre: Point, plan: Reticle, moment: Moment, is_best: bool) -> None:
    contrast, patterns = layers(plan)
    sky_disc(canvas, centre, _SMALL, plan, contrast / max(float(plan.combined.max()), 1e-9), patterns)
    if (best := moment.geometry) is not None:
        star(canvas, polar(centre, _SMALL, best.zenith, best.azimuth, plan.mission.widest), 8.0)
    colour = MAGENTA if is_best else INK
    canvas.text((centre[0], centre[1] - _SMALL - 30), str(moment.time)[11:16], 16, colour, anchor="mm")
    what = "none is good" if best is None else f"contrast {best.contrast:.0f}"
    canvas.text((centre[0], centre[1] + _SMALL + 16), what, 13, colour, anchor="mm")


def line_picture(mission: Mission, line: Line, words: Sequence[str] = ()) -> Image:
    """Draw the share of the field of view in glint by heading, and glint across the track on best and worst heading.

    `line` has the glint for all headings. `words` are lines of text above the chart, by default `line.words()`.
    """
    first, *rest = words or [line.words()]
    down = 25.0 * sum(len(draw.wrapped(text, 17, WIDTH - 80)) for text in rest)
    canvas = Canvas(WIDTH, 640 + round(down))
    canvas.text((40, 22), "Which way to fly", 26)
    canvas.text((40, 60), "   ".join(conditions(mission)), 15, GREY)
    canvas.text((40, 86), first, 20)
    canvas.lines((40, 116), rest, 17, 25, MAGENTA, width=WIDTH - 80)
    centre, radius = (290.0, 380.0 + down), 180.0
    for share in (0.25, 0.5, 0.75, 1.0):
        canvas.circle(centre, radius * share, PALE if share < 1 else INK, 1)
        at = (centre[0] + 4, centre[1] - radius * share)
        canvas.text(at, f"{100 * share:.0f} %", 13, GREY, anchor="lm", halo=True)
    half = 180.0 / line.heading.size
    for heading, fraction in zip(line.heading, line.fraction, strict=True):
        tips = [around(centre, radius * fraction, heading + d) for d in (-half, 0.0, half)]
        canvas.area([centre, *tips], (240, 190, 150))
    for turn in range(0, 360, 30):
        canvas.text(around(centre, radius + 22, turn), draw.azimuth_name(turn), 15, INK, anchor="mm")
    canvas.text(around(centre, radius + 52, mission.sun[1]), "sun", 14, _SUNNY, anchor="mm")
    if line.is_recommended:
        best = float(line.heading[line.best])
        canvas.arrow(around(centre, radius, best + 180.0), around(centre, radius, best), MAGENTA, 3, 16.0)
    canvas.text((centre[0], centre[1] + radius + 56), "share of the view in glint, by heading", 14, GREY, anchor="mm")
    _profiles(canvas, mission, line, (620.0, 170.0 + down, 560.0, 370.0))
    return canvas.finished()


def _profiles(canvas: Canvas, mission: Mission, line: Line, box: tuple[float, float, float, float]) -> None:
    left, top, width, height = box
    low, high = -6.0, 0.0
    half = max(float(line.across[-1]), 1e-6)

    def at(angle: float, value: float) -> Point:
        share = (np.clip(np.log10(max(value, 1e-30)), low, high) - low) / (high - low)
        return left + width * (angle + half) / (2 * half), top + height * (1.0 - float(share))

    limit = at(0, mission.limits.glint)[1]
    canvas.box(left, top, width, limit - top, (252, 240, 230))
    for power in range(int(low), int(high) + 1):
        y = at(0, 10.0**power)[1]
        canvas.line([(left, y), (left + width, y)], PALE, 1)
        canvas.text((left - 8, y), f"1e{power}" if power else "1", 13, INK, anchor="rm")
    for share in (-1.0, -0.5, 0.0, 0.5, 1.0):
        x = at(share * half, 1.0)[0]
        canvas.text((x, top + height + 16), f"{share * half:+.0f}°" if share else "0°", 13, INK, anchor="mm")
    canvas.line([(left, limit), (left + width, limit)], ORANGE, 2)
    canvas.text((left + 6, limit - 9), "limit", 13, ORANGE, anchor="lm")
    for k, colour, name in ((line.worst, GREY, "most"), (line.best, MAGENTA, "least")):
        values = line.profile[k]
        points = [at(float(a), float(v)) for a, v in zip(line.across, values, strict=True) if np.isfinite(v)]
        if points:
            canvas.line(points, colour, 3)
        place = (left + (0.0 if name == "least" else 220.0), top - 16)
        said = f"{name} glint: heading {line.heading[k]:03.0f}, {100 * line.fraction[k]:.0f} %"
        canvas.text(place, said, 15, colour, anchor="lm")
    unit = "largest along track [1/sr]" if line.view.along else "glint [1/sr]"
    canvas.text((left + width, top - 16), unit, 13, GREY, anchor="rm")
    below = (left + 0.5 * width, top + height + 40)
    canvas.text(below, "across-track angle: left -, right +", 14, GREY, anchor="mm")


def wind_picture(found: WindEnsemble) -> Image:
    """Draw the lowest contrast of each viewing geometry under all winds; hatch those that some or all winds exclude."""
    good = found.contrast[0]
    some = np.where((found.risk > 0) & (found.risk < 1), 1.0, -1.0)
    always = np.where(found.risk >= 1, 1.0, -1.0)
    what, *more = found.words()
    count = len(found.winds[0]) * len(found.winds[1])
    blows = f"Wind ± {found.speed:g} m/s and ± {found.turn:g}°: the worst of {count} winds"
    legend = ("/", ORANGE, "excluded under every wind"), (".", ORANGE, "excluded under some of these winds")
    top = float(good.max())
    shades = np.where(good > 0, good, layers(found.middle)[0]) / max(top, 1e-9)
    caption = Caption(blows, what, " ".join(more), legend, top)
    return page(found.middle, shades, [(some, ".", ORANGE), (always, "/", ORANGE)], found.best, caption)
