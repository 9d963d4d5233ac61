"""The plan as a picture for the cockpit: the object in the middle, viewing geometries around it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from . import draw
from .advice import ViewingGeometry, best_geometry, compass, quality, sentence
from .draw import BLUE, GREY, INK, MAGENTA, ORANGE, PALE, PAPER, YELLOW, Canvas, Image, Point
from .mission import Mission
from .reticle import Reticle

WIDTH, HEIGHT = 1240, 860
_CENTRE, _RADIUS = (418.0, 430.0), 345
_LEFT = 860  # of the words beside the disc
_HOW = (
    "The object is in the middle; a point of the disc is where the sensor stands, north up. Rings: degrees off nadir."
)


def picture(plan: Reticle, *, band: str | None = None, title: str = "Where to look from") -> Image:
    """Draw a plan.

    Parameters
    ----------
    plan : Reticle
    band : str, optional
        Show this band alone; by default all together.
    title : str

    Returns
    -------
    (row, column, 3) uint8 ndarray

    Raises
    ------
    BandError
        There is no such band.
    """
    contrast, patterns = layers(plan, band)
    geometry = best_geometry(plan, band=band)
    shown = "all bands together" if band is None else f"band {plan.mission.sensor.band(band).name} alone"
    limits = plan.mission.limits
    also = "" if limits.glint_probability is None else f", or on > {limits.glint_probability:.1g} of the sea"
    share = f"{100 * limits.sky_probability:g} %"
    legend = [
        ("/", ORANGE, f"excluded: sun glint (above {limits.glint:g} /sr{also})"),
        ("\\", BLUE, f"excluded: sky glint ({limits.sky_ratio:g}x the water on > {share} of the sea)"),
        (".", GREY, f"too faint, or saturated (contrast below {limits.snr:g} x noise)"),
    ]
    expects = "" if geometry is None else quality(geometry)
    top = float((plan.combined if band is None else plan.by_band[plan.index(band)]).max())
    words = Caption(title, f"Map: contrast over noise, {shown}", sentence(geometry), expects, tuple(legend), top)
    return page(plan, contrast / max(top, 1e-9), patterns, geometry, words)


class Caption(NamedTuple):
    """Text beside a disc.

    Attributes
    ----------
    title, shows, what, expects : str
        What the page is, what the map shows, the best viewing geometry, and what to expect of it.
    legend : tuple of (pattern, colour, str)
        Hatchings and their meaning.
    top : float
        Contrast at the top of the scale of colours; 0 for no scale.
    """

    title: str
    shows: str
    what: str
    expects: str
    legend: tuple[tuple[str, draw.Colour, str], ...]
    top: float


def page(
    plan: Reticle,
    share: npt.NDArray[Any],
    patterns: Sequence[tuple[Any, str, draw.Colour]],
    geometry: ViewingGeometry | None,
    words: Caption,
) -> Image:
    """A disc with its words; `share` is 0 to 1 of the scale of colours, `patterns` as for `draw.disc`."""
    canvas = Canvas(WIDTH, HEIGHT)
    draw.disc(canvas, _CENTRE, _RADIUS, share, patterns)
    scale(canvas, _CENTRE, _RADIUS, plan.mission.widest)
    marks(canvas, _CENTRE, _RADIUS, plan)
    if geometry is not None:
        _best(canvas, _CENTRE, _RADIUS, plan.mission.widest, geometry)
    y = _words(canvas, plan, words)
    y = _table(canvas, plan, geometry, y)
    _legend(canvas, words, y)
    _foot(canvas, plan)
    return canvas.finished()


def layers(plan: Reticle, band: str | None = None) -> tuple[npt.NDArray[Any], list[tuple[Any, str, draw.Colour]]]:
    """The contrast that is coloured, and what is hatched: too little contrast, mirrored sky, sun glint."""
    limits = plan.mission.limits
    with np.errstate(divide="ignore"):
        faint = np.clip(-np.log(plan.snr / max(limits.snr, 1e-9)), -5.0, 5.0)
        glint = np.log(np.maximum(plan.glint_strength, 1e-30) / limits.glint)
        if limits.glint_probability is not None:
            shares = np.maximum(plan.glint_probability, 1e-30) / max(limits.glint_probability, 1e-30)
            glint = np.maximum(glint, np.log(shares))
    faint = np.where(plan.detectable, np.minimum(faint, -1e-9), np.maximum(faint, 1e-9))
    sky = plan.sky_probability - limits.sky_probability
    if band is None:
        contrast = np.sqrt(np.sum(np.square(plan.snr * (plan.clear_of_sky & plan.detectable)), axis=0))
        sky, faint = np.maximum(sky, faint).min(axis=0), faint.min(axis=0)
        sky = np.where(faint > 0, -1e-9, sky)  # where all is too faint, sky is not to blame
    else:
        k = plan.index(band)
        contrast, sky, faint = plan.snr[k], sky[k], faint[k]
    return contrast, [(faint, ".", GREY), (sky, "\\", BLUE), (np.clip(glint, -5.0, 5.0), "/", ORANGE)]


def scale(canvas: Canvas, centre: Point, radius: int, widest: float, *, small: bool = False) -> None:
    """Rings of zenith angle and a compass rose around a disc."""
    every = 20 if widest > 40 else 10
    for ring in np.arange(every, widest + 0.1, every):
        canvas.circle(centre, radius * ring / widest, INK if ring == widest else GREY, 1)
        if not small:
            at = draw.polar(centre, radius, float(ring), 15.0, widest)
            canvas.text(at, f"{ring:.0f}°", 14, INK, anchor="mm", halo=True)
    canvas.circle(centre, radius, INK, 2)
    for azimuth in range(0, 360, 10):
        long = azimuth % 30 == 0
        start = draw.polar(centre, radius, widest, azimuth, widest)
        end = draw.polar(centre, radius + (9 if long else 5), widest, azimuth, widest)
        if not small:
            canvas.line([start, end], INK, 2 if long else 1)
        if long and (not small or azimuth == 0):
            name = {0: "N", 90: "E", 180: "S", 270: "W"}.get(azimuth, f"{azimuth:03d}")
            at = draw.polar(centre, radius + (11 if small else 26), 1.0, azimuth, 1.0)
            canvas.text(at, name, (13 if small else 22) if azimuth % 90 == 0 else 15, INK, anchor="mm")
    if not small:
        for azimuth in range(0, 360, 30):
            inner = draw.polar(centre, radius, 4.0, azimuth, widest)
            canvas.line([inner, draw.polar(centre, radius, widest, azimuth, widest)], (150, 155, 162), 1)


def marks(canvas: Canvas, centre: Point, radius: int, plan: Reticle, *, small: bool = False) -> None:
    """Object, sun, centre of the glint, and wind."""
    widest, mission = plan.mission.widest, plan.mission
    zenith, azimuth = mission.sun
    size = 6.0 if small else 13.0
    sun = draw.polar(centre, radius, min(zenith, widest * 1.0), azimuth, widest)
    _sun(canvas, sun, size)
    if small:
        return
    canvas.text((sun[0], sun[1] + 24), "sun", 15, INK, anchor="mm", halo=True)
    if zenith <= widest:
        glint = draw.polar(centre, radius, zenith, azimuth + 180.0, widest)
        canvas.circle(glint, 5, PAPER, -1)
        canvas.circle(glint, 5, ORANGE, 2)
        canvas.text((glint[0], glint[1] + 16), "mirror point", 14, INK, anchor="mm", halo=True)
    for colour, width in ((PAPER, 5), (INK, 2)):
        canvas.line([(centre[0] - 9, centre[1]), (centre[0] + 9, centre[1])], colour, width)
        canvas.line([(centre[0], centre[1] - 9), (centre[0], centre[1] + 9)], colour, width)
    _wind(canvas, centre, radius, plan)


def _wind(canvas: Canvas, centre: Point, radius: int, plan: Reticle) -> None:
    blows = plan.mission.wind_from
    start = draw.polar(centre, radius + 66, 1.0, blows, 1.0)
    end = draw.polar(centre, radius + 40, 1.0, blows, 1.0)
    canvas.arrow(start, end, BLUE, 4, 15.0)
    speed = f"{plan.mission.wind:g} m/s"
    if abs(np.sin(np.radians(blows))) > 0.9:  # beside the disc there is room for a short line only
        at = draw.polar(centre, radius + 46, 1.0, blows, 1.0)
        for k, line in enumerate(("wind", speed)):
            canvas.text((at[0], at[1] + 24 + 17 * k), line, 15, BLUE, anchor="mm")
        return
    at = draw.polar(centre, radius + 80, 1.0, blows, 1.0)
    canvas.text((at[0], at[1]), f"wind {speed}", 15, BLUE, anchor="mm")


def _sun(canvas: Canvas, at: Point, size: float) -> None:
    for k in range(8):
        turn = np.radians(45.0 * k)
        ray = [(at[0] + r * float(np.cos(turn)), at[1] + r * float(np.sin(turn))) for r in (size * 0.7, size * 1.25)]
        canvas.line(ray, INK, 2 if size > 8 else 1)
    canvas.circle(at, size * 0.72, YELLOW, -1)
    canvas.circle(at, size * 0.72, INK, 1)


def _best(canvas: Canvas, centre: Point, radius: int, widest: float, geometry: ViewingGeometry) -> None:
    at = draw.polar(centre, radius, geometry.zenith, geometry.azimuth, widest)
    if geometry.zenith >= 6.0:
        near = draw.polar(centre, radius, 3.0, geometry.azimuth, widest)
        canvas.arrow(at, near, PAPER, 6, 18.0)
        canvas.arrow(at, near, MAGENTA, 3, 14.0)
    star(canvas, at, 15.0)
    label = (at[0], at[1] - 26) if at[1] > centre[1] - radius + 60 else (at[0], at[1] + 28)
    canvas.text(label, "BEST", 17, MAGENTA, anchor="mm", halo=True)


def star(canvas: Canvas, at: Point, size: float) -> None:
    """The mark of the best viewing geometry."""
    for reach, colour in ((size * 1.3, PAPER), (size, MAGENTA)):
        turns = np.radians(np.arange(10) * 36.0 - 90.0)
        out = np.where(np.arange(10) % 2 == 0, reach, reach * 0.45)
        canvas.area(
            [(at[0] + float(r * np.cos(t)), at[1] + float(r * np.sin(t))) for r, t in zip(out, turns, strict=True)],
            colour,
        )


def _words(canvas: Canvas, plan: Reticle, words: Caption) -> float:
    canvas.text((_LEFT, 24), words.title, 26)
    y = 62.0
    for line in [*conditions(plan.mission), words.shows]:
        canvas.text((_LEFT, y), line, 15, GREY)
        y += 21
    y += 8
    start = y
    for text, size, height in ((words.what, 20, 27), (words.expects, 15, 20)):
        for line in draw.wrapped(text, size, WIDTH - _LEFT - 34) if text else []:
            canvas.text((_LEFT + 14, y), line, size)
            y += height
    canvas.box(_LEFT, start, 4, y - start, MAGENTA)
    return y + 16


def conditions(mission: Mission) -> list[str]:
    """Place and time, sun, and wind, a line each."""
    zenith, azimuth = mission.sun
    sun = f"Sun {90 - zenith:.0f}° high in the {compass(azimuth)} ({azimuth:03.0f}°)"
    blows = mission.wind_from % 360
    wind = f"Wind {mission.wind:g} m/s from the {compass(blows)} ({blows:03.0f}°)"
    return [line for line in (place_and_time(mission), sun, wind) if line]


def place_and_time(mission: Mission) -> str:
    """Place and time in a line; empty where neither is given."""
    out = []
    if mission.latitude is not None and mission.longitude is not None:
        longitude = (mission.longitude + 180.0) % 360.0 - 180.0
        north, east = "NS"[mission.latitude < 0], "EW"[longitude < 0]
        out.append(f"{abs(mission.latitude):.2f}° {north}  {abs(longitude):.2f}° {east}")
    if mission.moment is not None:
        out.append(f"{str(mission.moment)[:16].replace('T', ' ')} UTC")
    return "   ".join(out)


def _table(canvas: Canvas, plan: Reticle, geometry: ViewingGeometry | None, y: float) -> float:
    if geometry is None:
        return y
    i, j = plan.nearest(geometry.zenith, geometry.azimuth)
    edges = (_LEFT + 120, _LEFT + 192, _LEFT + 262, _LEFT + 340)
    for x, head in zip(edges, ("nm", "x noise", "Weber", "sky glint"), strict=True):
        canvas.text((x, y), head, 13, GREY, anchor="ra")
    canvas.text((_LEFT, y), "From there", 13, GREY)
    y += 19
    for k, band in enumerate(plan.mission.channels):
        good = bool(plan.by_band[k, i, j] > 0)
        colour = INK if good else (150, 155, 162)
        weber = plan.weber[k, i, j]
        cells = (
            f"{band.wavelength:.0f}",
            f"{plan.snr[k, i, j]:.1f}",
            f"{weber:+.2f}",
            f"{100 * plan.sky_probability[k, i, j]:.0f} %",
        )
        canvas.text((_LEFT, y), band.name[:9], 14, colour)
        for x, cell in zip(edges, cells, strict=True):
            canvas.text((x, y), cell, 14, colour, anchor="ra")
        y += 19
    return y + 14


def _legend(canvas: Canvas, words: Caption, y: float) -> None:
    x, row = _LEFT, round(y)
    if words.top > 0:
        colour_bar(canvas, x, row, 220)
        canvas.text((x, row + 18), "0", 13, GREY)
        canvas.text((x + 220, row + 18), f"{words.top:.3g} x noise", 13, GREY, anchor="ra")
        y = row + 44
    for pattern, colour, text in words.legend:
        draw.swatch(canvas, x, y, pattern, colour)
        for line in draw.wrapped(text, 13, WIDTH - _LEFT - 56):
            canvas.text((x + 38, y + 9), line, 13, INK, anchor="lm")
            y += 18
        y += 7
    for line in draw.wrapped(_HOW, 13, WIDTH - _LEFT - 34):
        canvas.text((x, y + 8), line, 13, GREY)
        y += 18


def colour_bar(canvas: Canvas, left: int, top: int, width: int, name: str = "viridis") -> None:
    """The colours of a scale, from 0 to its top."""
    canvas.image[top : top + 14, left : left + width] = draw.palette(np.linspace(0.0, 1.0, width), name)


def _foot(canvas: Canvas, plan: Reticle) -> None:
    mission = plan.mission
    target = f"Object {100 * mission.reflectance:g} % reflectance at {mission.depth:g} m"
    water = f"chlorophyll {mission.chlorophyll:g} mg/m3; visibility {mission.weather.visibility:g} km"
    said = [f"{target}; {water}; sensor {mission.sensor.name}.", *mission.cautions]
    lines = [line for text in said for line in draw.wrapped(text, 13, WIDTH - _LEFT - 34)]
    y = HEIGHT - 24 - 18 * len(lines)
    for line in lines:
        canvas.text((_LEFT, y), line, 13, GREY)
        y += 18
    canvas.line([(_LEFT - 24, 24), (_LEFT - 24, HEIGHT - 24)], PALE, 1)
