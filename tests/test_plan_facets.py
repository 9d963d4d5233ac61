"""The thesis' own way to a reticle, by brute force: a grid of facets, each mirrored and looked up.

It converges to what the planner has in closed form, slowly; here it is the planner's oracle.
"""

import numpy as np
import pytest

from deglint.physics import fresnel, glint, sky, slopes
from deglint.plan.skylight import LEVELS, Skylight, Wind


def unit(zenith, azimuth):
    z, a = np.radians(zenith), np.radians(azimuth)
    return np.array([np.sin(z) * np.sin(a), np.sin(z) * np.cos(a), np.cos(z)])


def facets(view, wind, wind_from, *, step, reach=1.0, centre=(0.0, 0.0), model="cox-munk"):
    """Mirrored rays (3, n), cosines of incidence, and each facet's share of the sea as the sensor sees it."""
    axis = np.arange(-reach + step / 2, reach, step)
    east, north = (c.ravel() for c in np.meshgrid(axis + centre[0], axis + centre[1], indexing="ij"))
    length = np.sqrt(1 + east**2 + north**2)
    normal = np.stack([-east, -north, np.ones_like(east)]) / length
    to_sensor = unit(*view)
    cosine = to_sensor @ normal
    ray = 2 * cosine * normal - to_sensor[:, None]
    density = slopes.density(*slopes.to_wind_axes(east, north, wind_from), wind, model=model)
    weight = density * step**2 * np.maximum(cosine, 0) * length / to_sensor[2]
    seen = cosine > 0
    return ray[:, seen], cosine[seen], weight[seen]


def glint_share(sun, view, wind, wind_from, *, half_angle, step, **options):
    """Share of the sea whose facets mirror the sensor into a cone around the sun (thesis, eq. 2.24)."""
    ray, _, weight = facets(view, wind, wind_from, step=step, **options)
    return weight[unit(*sun) @ ray > np.cos(np.radians(half_angle))].sum()


def glint_radiance(sun, view, wind, wind_from, *, half_angle, step, **options):
    """Radiance of glint per irradiance of a plane facing the sun: a disk of even radiance, facet by facet."""
    ray, cosine, weight = facets(view, wind, wind_from, step=step, **options)
    hit = unit(*sun) @ ray > np.cos(np.radians(half_angle))
    mirrored = fresnel.reflectance(np.degrees(np.arccos(np.clip(cosine[hit], 0, 1))))
    return (weight[hit] * mirrored).sum() / (4 * np.pi * np.sin(np.radians(half_angle) / 2) ** 2)


def sky_shares(sun, view, wind, wind_from, levels, *, step=0.005, model="uniform"):
    """Mean mirrored sky per diffuse irradiance, and the share of facets above each level (thesis, eq. 2.27)."""
    ray, cosine, weight = facets(view, wind, wind_from, step=step)
    up = ray[2] > 0
    ray, cosine, weight = ray[:, up], cosine[up], weight[up]
    zenith = np.degrees(np.arccos(np.clip(ray[2], 0, 1)))
    azimuth = np.degrees(np.arctan2(ray[0], ray[1]))
    light = sky.radiance(zenith, azimuth, *sun, model=model)
    light = light * fresnel.reflectance(np.degrees(np.arccos(np.clip(cosine, 0, 1))))
    return (weight * light).sum(), np.array([weight[light > level].sum() for level in levels])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "half_angle", "step", "tolerance"),
    [
        ((20.5, 270.2, 0, 0, 9, 0), 1.0, 0.0005, 0.01),
        ((20.5, 270.2, 0, 0, 9, 0), 2.0, 0.0005, 0.01),
        ((20.5, 270.2, 40, 90.2, 9, 0), 1.0, 0.0005, 0.01),
        ((30, 180, 30, 0, 5, 0), 1.0, 0.0005, 0.01),
        ((20.5, 270.2, 0, 0, 9, 0), 0.2665, 0.0001, 0.01),
        ((60, 180, 60, 0, 10, 0), 0.2665, 0.00005, 0.01),
    ],
)
def test_closed_form_is_the_limit_of_the_facet_grid(case, half_angle, step, tolerance):
    facet = glint.facet(*case[:4])
    window = {"centre": (float(facet.east), float(facet.north)), "reach": 6 * np.tan(np.radians(half_angle))}
    found = glint.sun_glint(*case[:4], wind=case[4], wind_from=case[5])
    closed = glint.probability(found.density, case[2], found.tilt, glint.cone(half_angle))
    share = glint_share(case[:2], case[2:4], *case[4:], half_angle=half_angle, step=step, **window)
    bright = glint_radiance(case[:2], case[2:4], *case[4:], half_angle=half_angle, step=step, **window)
    assert share == pytest.approx(float(closed), rel=tolerance)
    assert bright == pytest.approx(float(found.radiance), rel=tolerance)


def test_the_facet_grid_of_the_thesis_does_not_resolve_the_sun_but_converges():
    """Steps of .02 and .01 miss the true disk or see it several times too large; finer ones come closer."""
    closed = float(glint.sun_glint(20.5, 270.2, 0, 0, wind=9, wind_from=0).probability)
    assert closed == pytest.approx(5.06e-5, rel=2e-3)
    wrong, shares = [], []
    for step in (0.02, 0.01, 0.002, 0.0005, 0.0001):
        window = {"reach": 0.3 if step > 1e-3 else 0.01, "centre": (step / 2 + (step < 1e-3) * 0.18, step / 2)}
        share = glint_share((20.5, 270.2), (0, 0), 9, 0, half_angle=0.2665, step=step, **window)
        shares.append(share)
        wrong.append(abs(share / closed - 1))
    assert shares[:2] == pytest.approx([1.13e-3, 2.81e-4], rel=5e-3)
    assert wrong[2] < 0.5
    assert wrong[3] < 0.1
    assert wrong[4] < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("model", sky.SKY_MODELS)
@pytest.mark.parametrize(
    ("wind", "sun_at", "tolerance"),
    [
        (9.0, (20.5, 270.2), 0.01),
        (2.0, (45.0, 100.0), 0.01),
        (14.0, (70.0, 30.0), 0.01),
        (2.0, (80.0, 25.0), 0.01),  # the glow that is mirrored at 205 degrees is narrow
    ],
)
def test_mirrored_sky_is_the_sum_at_every_look(model, wind, sun_at, tolerance):
    zenith, azimuth = np.arange(81.0), np.arange(361.0)
    found = Skylight(zenith, azimuth, sun_at, Wind(wind, 30.0, "cox-munk"), model=model)
    views, turns = np.array([0, 17, 33, 52, 70, 80]), np.array([0, 95, 157, 205, 283])
    exact = sky.reflectance(views[:, None], turns, *sun_at, wind=wind, wind_from=30.0, model=model)
    np.testing.assert_allclose(found.mean[views[:, None], turns], exact, rtol=tolerance)


@pytest.mark.parametrize("model", ["uniform", "harrison-coombes"])
@pytest.mark.parametrize("view", [(0.0, 0.0), (40.0, 120.0), (60.0, 200.0)])
def test_share_of_bright_facets_is_that_of_the_facet_grid(model, view):
    zenith, azimuth = np.arange(81.0), np.arange(361.0)
    sun_at = (35.0, 150.0)
    found = Skylight(zenith, azimuth, sun_at, Wind(7.0, 30.0, "cox-munk"), model=model)
    levels = LEVELS[12:90:6]
    step = LEVELS[1] / LEVELS[0]  # levels are distinguished to one step, 6 %
    mean, below = sky_shares(sun_at, view, 7.0, 30.0, levels / step, model=model)
    _, above = sky_shares(sun_at, view, 7.0, 30.0, levels * step, model=model)
    i, j = int(view[0]), int(view[1])
    assert found.mean[i, j] == pytest.approx(mean, rel=0.01)
    got = np.array([float(found.share_above(np.full((1, 81, 361), level))[0, i, j]) for level in levels])
    assert (got <= below + 0.015).all()
    assert (got >= above - 0.015).all()


def test_brighter_sky_is_rarer():
    found = Skylight(np.arange(81.0), np.arange(361.0), (30.0, 90.0), Wind(5.0, 0.0, "cox-munk"), model="uniform")
    assert (np.diff(found.brighter, axis=0) <= 1e-6).all()
    total = found.brighter[0]
    assert total.min() > 0.9
    assert total.max() <= 1.0
