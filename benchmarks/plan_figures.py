"""The figures of the thesis' chapter 2, made again with the planner (docs/planning.md).

    python -m benchmarks plan_figures [--directory FOLDER]

The sun's zenith angle is 20.5 degrees, its azimuth 270.2 degrees; the wind is 9 m/s at a height of 12.5 m. The thesis
gives neither the direction of the wind nor the water and the object. Here the wind comes from the north, chlorophyll is
0.5 mg m-3, and the object has a reflectance of 15 % and lies at a depth of 10 m.
"""

from __future__ import annotations

import numpy as np
from PIL import Image

from deglint.physics import glint, slopes
from deglint.plan import Limits, Mission, reticle
from deglint.plan.charts import day_picture, line_picture, selected, wind_picture
from deglint.plan.draw import GREY, INK, ORANGE, Canvas, palette
from deglint.plan.picture import layers, picture, sky_disc
from deglint.plan.swath import FieldOfView, Line, alternatives, words
from deglint.plan.sweep import WindEnsemble, plans, times

from .timing import ROOT

RADIUS = 150
THESIS = {"sun_zenith": 20.5, "sun_azimuth": 270.2, "wind": 9.0, "wind_height": 12.5, "depth": 10.0}


def panel(canvas, column, plan, values, title, *, patterns=(), high=""):
    """Draw a disc of `values` (0 to 1) with a title; with `high`, the label of 1, also a scale of colours below."""
    centre = (40 + RADIUS + column * (2 * RADIUS + 70), 76 + RADIUS)
    for k, line in enumerate(title.split("\n")):
        canvas.text((centre[0], 22 + 19 * k), line, 15, INK if k == 0 else GREY, anchor="mm")
    sky_disc(canvas, centre, RADIUS, plan, values, patterns)
    left, top = round(centre[0] - 100), round(centre[1] + RADIUS + 24)
    if high:
        canvas.image[top : top + 12, left : left + 200] = palette(np.linspace(0, 1, 200))
        canvas.text((left, top + 16), "0", 13, GREY)
        canvas.text((left + 200, top + 16), high, 13, GREY, anchor="ra")


def sheet(columns):
    return Canvas(40 + columns * (2 * RADIUS + 70), 76 + 2 * RADIUS + 62)


def slopes_2_2():
    """Fig. 2.2: density of the slopes of waves at winds of 2 and 9 m/s."""
    side = 300
    canvas = Canvas(2 * (side + 70) + 30, side + 130)
    axis = np.linspace(-0.6, 0.6, side)
    for column, wind in enumerate((2.0, 9.0)):
        density = slopes.density(-axis[:, None], axis[None, :], wind)  # upwind is up
        left, top = 50 + column * (side + 70), 60
        canvas.image[top : top + side, left : left + side] = palette(density / density.max())
        canvas.text((left + side / 2, 24), f"wind {wind:g} m/s", 16, INK, anchor="mm")
        canvas.text((left + side / 2, 46), f"largest {density.max():.1f}", 13, GREY, anchor="mm")
        for share, slope in ((0.0, -0.6), (0.5, 0.0), (1.0, 0.6)):
            canvas.text((left + share * side, top + side + 12), f"{slope:+.1f}", 13, GREY, anchor="mm")
            canvas.text((left - 8, top + (1 - share) * side), f"{slope:+.1f}", 13, GREY, anchor="rm")
        canvas.text((left + side / 2, top + side + 36), "crosswind slope (upwind slope upward)", 13, GREY, anchor="mm")
    return canvas


def facet_sum(plan, step):
    """The thesis' glint probability (eq. 2.24): sum of density x area over the cells of slopes that mirror the sun."""
    sun_zenith, sun_azimuth = plan.mission.sun
    facet = glint.facet(sun_zenith, sun_azimuth, plan.zenith[:, None], plan.azimuth)
    to_sun = glint.direction(sun_zenith, sun_azimuth)
    to_sensor = glint.direction(plan.zenith[:, None], plan.azimuth)
    found = np.zeros(facet.east.shape)
    for i in range(-2, 3):
        for j in range(-2, 3):
            east, north = (np.rint(z / step + k) * step for z, k in ((facet.east, i), (facet.north, j)))
            length = np.sqrt(1 + east**2 + north**2)
            normal = (-east / length, -north / length, 1 / length)
            cosine = sum(n * v for n, v in zip(normal, to_sensor, strict=True))
            ray = [2 * cosine * n - v for n, v in zip(normal, to_sensor, strict=True)]
            hit = sum(r * s for r, s in zip(ray, to_sun, strict=True)) > np.cos(np.radians(0.2665))
            density = slopes.density(*slopes.to_wind_axes(east, north, plan.mission.wind_from), 9.0)
            found += hit * density * step**2
    return found


def glint_2_10(plan):
    """Fig. 2.10: probability of glint by cells of slopes and in closed form, and its mask."""
    canvas = sheet(3)
    coarse = facet_sum(plan, 0.01)
    limit = plan.glint_probability.max()
    title = "facet grid, steps of 0.01\nas the thesis: sees the disk or misses it"
    panel(canvas, 0, plan, coarse / 1e-3, title, high="1e-3")
    title = "closed form\nshare of the sea that mirrors the sun"
    panel(canvas, 1, plan, plan.glint_probability / limit, title, high=f"{limit:.2g}")
    mask = [p for p in layers(plan)[1] if p[2] == ORANGE]
    panel(canvas, 2, plan, np.full_like(coarse, 0.65), "mask\nglint above 1e-3 per sr", patterns=mask)
    return canvas


def beside_its_mask(plan, values, title, *, pattern, mask, high, shaded=True):
    """Draw a layer of the blue band (0 to 1), and beside it its mask over the layer, or over one shade."""
    canvas = sheet(2)
    panel(canvas, 0, plan, values, title, high=high)
    patterns = [p for p in layers(plan, "BLUE")[1] if p[1] == pattern]
    panel(canvas, 1, plan, values if shaded else np.full_like(values, 0.65), f"mask\n{mask}", patterns=patterns)
    return canvas


def maps_2_13(full, absorbing):
    """Fig. 2.13: the combined map of the blue band with water that only absorbs, and with water that scatters."""
    canvas = sheet(2)
    top = max(p.snr[1].max() for p in (full, absorbing))
    titles = "water that only absorbs\nthe thesis' fast tool", "water that scatters\nthe thesis' HydroLight tool"
    for column, (plan, title) in enumerate(zip((absorbing, full), titles, strict=True)):
        contrast, patterns = layers(plan, "BLUE")
        panel(canvas, column, plan, contrast / top, title, patterns=patterns, high=f"{top:.1f} x noise")
    return canvas


def examples():
    """Pictures of the four kinds of plans, by name."""
    bay = Mission(latitude=36.8, longitude=-122.0, time="2026-06-21T18:00Z", wind=7.0, wind_from=310.0)
    found = list(plans(bay, times("2026-06-21T13:00Z", "2026-06-22T02:30Z", 90)))
    moments = [moment for moment, _ in found]
    line = Line(bay, FieldOfView(across=30.0, roll=25.0))
    return {
        "reticle": picture(reticle(bay)),
        "day": day_picture(bay, moments, {k: found[k][1] for k in selected(moments)}),
        "heading": line_picture(bay, line, words(line, alternatives(bay, line))),
        "wind": wind_picture(WindEnsemble(bay)),
    }


def main(directory):
    directory = directory or ROOT / "docs"
    limits = Limits(ner=5e-4, snr=15.0)
    full = reticle(Mission(**THESIS, sky="uniform", limits=limits))
    absorbing = reticle(Mission(**THESIS, sky="uniform", limits=limits, water="absorption"))
    top = full.snr[1].max()
    figures = {
        "slopes": slopes_2_2(),
        "glint": glint_2_10(full),
        "sky": beside_its_mask(  # fig. 2.11
            full, full.sky_probability[1], "share of the sea that mirrors sky\nof more than twice the water, blue",
            pattern="\\", mask="more than 10 % of the sea", high="1", shaded=False,
        ),
        "noise": beside_its_mask(  # fig. 2.12
            full, full.snr[1] / top, "contrast over noise, blue\nNER 5e-4 W m-2 sr-1 nm-1",
            pattern=".", mask=f"contrast below {limits.snr:g}", high=f"{top:.1f}",
        ),
        "maps": maps_2_13(full, absorbing),
    }  # fmt: skip
    images = {name: canvas.finished() for name, canvas in figures.items()} | examples()
    for name, image in images.items():
        path = directory / f"planning_{name}.png"
        Image.fromarray(image).save(path, optimize=True)
        print(f"{path} {path.stat().st_size / 1e3:.0f} kB")
    ratio = absorbing.snr[1] / full.snr[1]
    said = f"{ratio[0, 0]:.3f} at nadir, {ratio[60, 0]:.3f} at 60 degrees"
    print(f"contrast, absorbing over scattering water, blue: {said}")
    print(f"facet sum: largest {facet_sum(full, 0.01).max():.2g}, closed form {full.glint_probability.max():.3g}")
