"""Draw a plan as a disc: the object is at the centre, and each point of the disc is a viewing geometry."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from . import draw
from .draw import BLUE, GREY, INK, MAGENTA, ORANGE, PALE, PAPER, YELLOW, Canvas, Image, Pattern, Point, around, polar
from .mission import Mission
from .reticle import Reticle, ViewingGeometry, best_geometry, compass, quality, sentence

WIDTH, HEIGHT = 1240, 860  # size of the picture [pixel]
DISC_CENTRE, DISC_RADIUS = (418.0, 430.0), 345  # centre (x, y) and radius of the disc [pixel]
LABELLED = 200  # least radius of a disc with a compass rose and labels of the rings [pixel]
_LEFT = 860  # left edge of the text beside the disc [pixel]
_COLUMN = WIDTH - _LEFT - 34  # width of the text [pixel]
_MOST_ROWS = 12  # largest number of bands in the table; the legend needs the space below it
_PALE_INK = (150, 155, 162)  # colour of bands that are not usable, and of lines in the disc
_HOW = (
    "The object is in the middle; a point of the disc is where the sensor stands, north up. Rings: degrees off nadir."
)


def picture(plan: Reticle, *, band: str | None = None) -> Image:
    """Draw a plan for all bands together, or for one band (its name). Raises BandError if the plan has no such band."""
    contrast, patterns = layers(plan, band)
    geometry = best_geometry(plan, band=band)
    shown = "all bands together" if band is None else f"band {plan.mission.sensor.band(band).name} alone"
    limits = plan.mission.limits
    also = "" if limits.glint_probability is None else f", or on > {limits.glint_probability:.1g} of the sea"
    share = f"{100 * limits.sky_probability:g} %"
    legend = (
        ("/", ORANGE, f"excluded: sun glint (above {limits.glint:g} /sr{also})"),
        ("\\", BLUE, f"excluded: sky glint ({limits.sky_ratio:g}x the water on > {share} of the sea)"),
        (".", GREY, f"too faint, or saturated (contrast below {limits.snr:g} x noise)"),
    )
    expects = "" if geometry is None else quality(geometry)
    top = float((plan.combined if band is None else plan.by_band[plan.index(band)]).max())
    words = Caption(f"Map: contrast over noise, {shown}", sentence(geometry), expects, legend, top)
    return page(plan, contrast / max(top, 1e-9), patterns, geometry, words)


class Caption(NamedTuple):
    """Text beside the disc of a plan."""

    shows: str  # what the map shows
    what: str  # sentence that says from where to look
    expects: str  # contrast and glint to expect from there
    legend: tuple[tuple[str, draw.Colour, str], ...]  # hatchings and their meaning
    top: float  # contrast over noise at the top of the colour scale; 0: no scale is drawn


def page(
    plan: Reticle, share: draw.Values, patterns: Sequence[Pattern], geometry: ViewingGeometry | None, words: Caption
) -> Image:
    """Draw a disc of viewing geometries with the text `words` beside it, and mark `geometry` as the best one.

    `share` (zenith, azimuth) gives the colour, 0 to 1, and `patterns` the hatchings, as in `draw.disc`.
    """
    canvas = Canvas(WIDTH, HEIGHT)
    sky_disc(canvas, DISC_CENTRE, DISC_RADIUS, plan, share, patterns)
    _sun_and_wind(canvas, plan.mission)
    if geometry is not None:
        _best(canvas, plan.mission.widest, geometry)
    y = _words(canvas, plan, words)
    if geometry is not None:
        y = _table(canvas, plan, geometry, y)
    _legend(canvas, words, y)
    _foot(canvas, plan)
    return canvas.finished()


def layers(plan: Reticle, band: str | None = None) -> tuple[draw.Values, list[Pattern]]:
    """Contrast over noise (zenith, azimuth); hatchings for low contrast or saturation, for sky glint and for sun glint.

    The contrast is that of `band`. By default, it combines all bands that are detectable and clear of sky glint.
    """
    # arrays of hatchings are smooth, and above 0 where hatched: `draw.disc` interpolates them to draw smooth edges
    limits = plan.mission.limits
    with np.errstate(divide="ignore"):
        faint = np.clip(-np.log(plan.snr / max(limits.snr, 1e-9)), -5.0, 5.0)
        glint = np.log(np.maximum(plan.glint_strength, 1e-30) / limits.glint)
        if limits.glint_probability is not None:
            shares = np.maximum(plan.glint_probability, 1e-30) / max(limits.glint_probability, 1e-30)
            glint = np.maximum(glint, np.log(shares))
    glint = np.where(plan.clear_of_glint, np.minimum(glint, 0.0), np.maximum(glint, 1e-9))
    faint = np.where(plan.detectable, np.minimum(faint, -1e-9), np.maximum(faint, 1e-9))
    sky = plan.sky_probability - limits.sky_probability
    if band is None:  # root sum square of the bands that are detectable and clear of sky glint
        contrast = np.sqrt(np.sum(np.square(plan.snr * (plan.clear_of_sky & plan.detectable)), axis=0))
        sky, faint = np.maximum(sky, faint).min(axis=0), faint.min(axis=0)
        sky = np.where(faint > 0, -1e-9, sky)  # too faint in every band: not hatched as reflected sky
    else:
        k = plan.index(band)
        contrast, sky, faint = plan.snr[k], sky[k], faint[k]
    return contrast, [(faint, ".", GREY), (sky, "\\", BLUE), (np.clip(glint, -5.0, 5.0), "/", ORANGE)]


def sky_disc(
    canvas: Canvas, centre: Point, radius: int, plan: Reticle, share: draw.Values, patterns: Sequence[Pattern] = ()
) -> None:
    """Draw a disc as in `draw.disc`, with the sun and rings of equal zenith angle; a large disc has a compass rose."""
    draw.disc(canvas, centre, radius, share, patterns)
    widest, small = plan.mission.widest, radius < LABELLED
    every = 20 if widest > 40 else 10
    for ring in np.arange(every, widest + 0.1, every):
        canvas.circle(centre, radius * ring / widest, INK if ring == widest else GREY, 1)
        if not small:
            canvas.text(polar(centre, radius, ring, 15.0, widest), f"{ring:.0f}°", 14, INK, anchor="mm", halo=True)
    canvas.circle(centre, radius, INK, 2)
    if small:
        canvas.text(around(centre, radius + 11, 0.0), "N", 13, INK, anchor="mm")
    else:
        _rose(canvas, centre, radius, widest)
    zenith, azimuth = plan.mission.sun
    at, size = polar(centre, radius, min(zenith, widest), azimuth, widest), 6.0 if small else 13.0
    for k in range(8):
        canvas.line([around(at, size * reach, 45.0 * k) for reach in (0.7, 1.25)], INK, 1 if small else 2)
    canvas.circle(at, size * 0.72, YELLOW, -1)
    canvas.circle(at, size * 0.72, INK, 1)


def _rose(canvas: Canvas, centre: Point, radius: int, widest: float) -> None:
    for azimuth in range(0, 360, 10):
        tick = 5 if azimuth % 30 else 9
        canvas.line([around(centre, radius + out, azimuth) for out in (0, tick)], INK, 1 if azimuth % 30 else 2)
    for azimuth in range(0, 360, 30):
        size = 15 if azimuth % 90 else 22
        canvas.text(around(centre, radius + 26, azimuth), draw.azimuth_name(azimuth), size, INK, anchor="mm")
        canvas.line([polar(centre, radius, 4.0, azimuth, widest), around(centre, radius, azimuth)], _PALE_INK, 1)


def _sun_and_wind(canvas: Canvas, mission: Mission) -> None:
    """Label the sun on the disc, and mark the specular point, the object at the centre, and the wind."""
    (x, y), radius, widest = DISC_CENTRE, DISC_RADIUS, mission.widest
    zenith, azimuth = mission.sun
    right, down = polar(DISC_CENTRE, radius, min(zenith, widest), azimuth, widest)
    canvas.text((right, down + 24), "sun", 15, INK, anchor="mm", halo=True)
    if zenith <= widest:
        glint = polar(DISC_CENTRE, radius, zenith, azimuth + 180.0, widest)
        canvas.circle(glint, 5, PAPER, -1)
        canvas.circle(glint, 5, ORANGE, 2)
        canvas.text((glint[0], glint[1] + 16), "mirror point", 14, INK, anchor="mm", halo=True)
    for colour, width in ((PAPER, 5), (INK, 2)):
        canvas.line([(x - 9, y), (x + 9, y)], colour, width)
        canvas.line([(x, y - 9), (x, y + 9)], colour, width)
    blows, speed = mission.wind_from, f"{mission.wind:g} m/s"
    canvas.arrow(around(DISC_CENTRE, radius + 66, blows), around(DISC_CENTRE, radius + 40, blows), BLUE, 4, 15.0)
    if abs(np.sin(np.radians(blows))) > 0.9:  # beside the disc there is room for a short line only
        right, down = around(DISC_CENTRE, radius + 46, blows)
        canvas.text((right, down + 24), "wind", 15, BLUE, anchor="mm")
        canvas.text((right, down + 41), speed, 15, BLUE, anchor="mm")
    else:
        canvas.text(around(DISC_CENTRE, radius + 80, blows), f"wind {speed}", 15, BLUE, anchor="mm")


def _best(canvas: Canvas, widest: float, geometry: ViewingGeometry) -> None:
    x, y = at = polar(DISC_CENTRE, DISC_RADIUS, geometry.zenith, geometry.azimuth, widest)
    if geometry.zenith >= 6.0:
        near = polar(DISC_CENTRE, DISC_RADIUS, 3.0, geometry.azimuth, widest)
        canvas.arrow(at, near, PAPER, 6, 18.0)
        canvas.arrow(at, near, MAGENTA, 3, 14.0)
    star(canvas, at, 15.0)
    label = y - 26 if y > DISC_CENTRE[1] - DISC_RADIUS + 60 else y + 28
    canvas.text((x, label), "BEST", 17, MAGENTA, anchor="mm", halo=True)


def star(canvas: Canvas, at: Point, size: float) -> None:
    """Draw a star, which marks the best viewing geometry; `size` is its radius [pixel]."""
    for reach, colour in ((size * 1.3, PAPER), (size, MAGENTA)):
        canvas.area([around(at, reach * (0.45 if k % 2 else 1.0), 36.0 * k) for k in range(10)], colour)


def _words(canvas: Canvas, plan: Reticle, words: Caption) -> float:
    canvas.text((_LEFT, 24), "Where to look from", 26)
    start = canvas.lines((_LEFT, 62.0), [*conditions(plan.mission), words.shows], 15, 21, GREY) + 8
    y = canvas.lines((_LEFT + 14, start), [words.what], 20, 27, width=_COLUMN)
    if words.expects:
        y = canvas.lines((_LEFT + 14, y), [words.expects], 15, 20, width=_COLUMN)
    canvas.box(_LEFT, start, 4, y - start, MAGENTA)
    return y + 16


def conditions(mission: Mission) -> list[str]:
    """Lines of text that state place and time, sun, and wind of a mission."""
    zenith, azimuth = mission.sun
    sun = f"Sun {90 - zenith:.0f}° high in the {compass(azimuth)} ({azimuth:03.0f}°)"
    blows = mission.wind_from % 360
    wind = f"Wind {mission.wind:g} m/s from the {compass(blows)} ({blows:03.0f}°)"
    when = "" if mission.moment is None else f"{str(mission.moment)[:16].replace('T', ' ')} UTC"
    place_and_time = "   ".join(text for text in (place_words(mission), when) if text)
    return [line for line in (place_and_time, sun, wind) if line]


def place_words(mission: Mission) -> str:
    """Latitude and longitude of a mission as text; empty if not given."""
    if mission.place is None:
        return ""
    latitude, longitude = mission.place[0], (mission.place[1] + 180.0) % 360.0 - 180.0
    return f"{abs(latitude):.2f}° {'S' if latitude < 0 else 'N'}  {abs(longitude):.2f}° {'W' if longitude < 0 else 'E'}"


def _table(canvas: Canvas, plan: Reticle, geometry: ViewingGeometry, y: float) -> float:
    i, j = plan.nearest(geometry.zenith, geometry.azimuth)
    edges = (_LEFT + 120, _LEFT + 192, _LEFT + 262, _LEFT + 340)
    for x, head in zip(edges, ("nm", "x noise", "Weber", "sky glint"), strict=True):
        canvas.text((x, y), head, 13, GREY, anchor="ra")
    canvas.text((_LEFT, y), "From there", 13, GREY)
    y += 19
    for k, band in enumerate(plan.mission.channels[:_MOST_ROWS]):
        colour = INK if plan.by_band[k, i, j] > 0 else _PALE_INK
        snr, weber, sky = plan.snr[k, i, j], plan.weber[k, i, j], plan.sky_probability[k, i, j]
        canvas.text((_LEFT, y), band.name[:9], 14, colour)
        cells = (f"{band.wavelength:.0f}", f"{snr:.1f}", f"{weber:+.2f}", f"{100 * sky:.0f} %")
        for x, cell in zip(edges, cells, strict=True):
            canvas.text((x, y), cell, 14, colour, anchor="ra")
        y += 19
    if left := plan.mission.channels[_MOST_ROWS:]:
        canvas.text((_LEFT, y), f"and {len(left)} more", 14, GREY)
        y += 19
    return y + 14


def _legend(canvas: Canvas, words: Caption, y: float) -> None:
    if words.top > 0:
        row = round(y)
        canvas.image[row : row + 14, _LEFT : _LEFT + 220] = draw.palette(np.linspace(0.0, 1.0, 220))
        canvas.text((_LEFT, row + 18), "0", 13, GREY)
        canvas.text((_LEFT + 220, row + 18), f"{words.top:.3g} x noise", 13, GREY, anchor="ra")
        y = row + 44
    for pattern, colour, text in words.legend:
        draw.swatch(canvas, _LEFT, y, pattern, colour)
        for line in draw.wrapped(text, 13, WIDTH - _LEFT - 56):
            canvas.text((_LEFT + 38, y + 9), line, 13, anchor="lm")
            y += 18
        y += 7
    canvas.lines((_LEFT, y + 8), [_HOW], 13, 18, GREY, width=_COLUMN)


def _foot(canvas: Canvas, plan: Reticle) -> None:
    mission = plan.mission
    target = f"Object {100 * mission.reflectance:g} % reflectance at {mission.depth:g} m"
    water = f"chlorophyll {mission.chlorophyll:g} mg/m3; visibility {mission.weather.visibility:g} km"
    said = [f"{target}; {water}; sensor {mission.sensor.name}.", *mission.cautions]
    down = 18 * sum(len(draw.wrapped(text, 13, _COLUMN)) for text in said)
    canvas.lines((_LEFT, HEIGHT - 24 - down), said, 13, 18, GREY, width=_COLUMN)
    canvas.line([(_LEFT - 24, 24), (_LEFT - 24, HEIGHT - 24)], PALE, 1)
