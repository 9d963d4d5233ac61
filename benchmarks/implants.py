"""Targets put into scenes before the optics blur them, and how much of their contrast is left.

A target is opaque and flat. It changes the radiance L of a pixel to ``L' = L (1 - p) + p R E / pi``: p is the share of
the pixel that it covers, seen through the optics, R its reflectance, E the irradiance. New noise is added. The excess
is the difference from the true scene without targets, relative to a target of reflectance 1. The contrast left is the
slope (least squares) of excess over true excess in visible bands, where the latter is over a quarter of its maximum.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import rasterio

from deglint.physics.presets import preset
from deglint.physics.sensor import Sensor, mtf
from deglint.raster.simulated import write_scene
from deglint.simulate import Setup, simulate, thesis_array
from deglint.simulate.scene import Light
from detect.bench.numbers import VISIBLE_BANDS

from .files import DATA, plane, values

Image = npt.NDArray[np.float64]
Curve = Callable[[Image], Image]
Kind = tuple[str, int]

SENSOR = preset("thesis")
GRID_STEP, OUTLINE_SIDE, SIZES = 24, 33, (1, 2, 3, 5)
"""Step of the grid of targets, side of the area of one target's outline, and sides of targets [pixel]."""
LEAST_KEPT, MOST_KEPT = 0.8, 1.25
"""Least and largest share of its contrast with which a target survives."""


def _falls(at: float, softness: float = 15.0) -> Curve:
    return lambda w: 1 / (1 + np.exp((w - at) / softness))


COLOURS: dict[str, Curve] = {
    "white 70 %": lambda w: 0.70 + 0 * w,
    "white 30 %": lambda w: 0.30 + 0 * w,
    "white 10 %": lambda w: 0.10 + 0 * w,
    "grey 5 %": lambda w: 0.05 + 0 * w,
    "dark": lambda w: 0.005 + 0 * w,
    "red": lambda w: 0.48 - 0.45 * _falls(600, 12)(w),
    "blue": lambda w: 0.03 + 0.35 * _falls(510)(w),
    "blue dye": lambda w: 0.43 + 0.35 * _falls(510)(w) - 0.4 * _falls(740)(w),
}
"""Reflectance by wavelength [nm]; "blue dye" is bright in the near infrared, as many dyes are."""


def reflectance(colour: str, sensor: Sensor) -> Image:
    """Mean reflectance of a colour in each band of a sensor, (band,)."""
    return np.array([COLOURS[colour](np.arange(b.low, b.high + 1)).mean() for b in sensor.bands])


def scale(sensor: Sensor) -> Image:
    """Radiance of one digital number in each band, (band, 1, 1)."""
    return np.array([sensor.scale(b) for b in sensor.bands])[:, None, None]


@dataclass(frozen=True)
class Target:
    """A square target: its colour and side, and row and column of the pixel at its middle."""

    colour: str
    size: int
    row: int
    column: int


@dataclass(frozen=True)
class Sea:
    """A scene: its file; image, truth and glint in digital numbers, (band, row, column); and objects under water."""

    path: Path
    image: Image
    truth: Image
    glint: Image
    objects: npt.NDArray[Any]
    sensor: Sensor = SENSOR


@cache
def white(sensor: Sensor) -> Image:
    """Digital numbers of a target of reflectance 1, (band,)."""
    lit = Light(Setup(sensor=sensor))
    return np.asarray((lit.direct + lit.diffuse) / np.pi / scale(sensor).ravel())


@cache
def outline(sensor: Sensor, size: int, down: float, right: float, speed: float) -> Image:
    """Share of each pixel that a square covers, seen through the optics, (band, `OUTLINE_SIDE`, `OUTLINE_SIDE`).

    `size`, and the shift from the middle `down` and `right`, are in pixels; `speed` is to the right [m/s].
    """
    fine = np.fft.fftfreq(OUTLINE_SIDE * 8, 1 / 8)
    out, middle, square = [], 0.0 if size % 2 else 0.5, np.sinc(size * fine)
    for band in sensor.bands:
        moved = right + speed * band.time_offset / sensor.gsd
        spectrum = mtf(fine[:, None], fine[None], sensor, band.wavelength) * np.outer(square, square)
        spectrum = spectrum * np.exp(-2j * np.pi * np.add.outer(fine * (down + middle), fine * (moved + middle)))
        out.append(np.fft.fftshift((np.fft.ifft2(spectrum * size**2).real * 64)[::8, ::8]))
    return np.clip(np.stack(out), 0, 1)


def implant(
    sea: Sea, kinds: Sequence[Kind], seed: int, speed: float = 0.0, step: int = GRID_STEP
) -> tuple[Sea, list[Target]]:
    """Put targets of (colour, side) `kinds` into a scene, on a grid, but not near objects under water.

    Returns the new scene, and the targets. If `seed` is odd, targets are shifted by quarters of a pixel.
    """
    rng, image, truth = np.random.default_rng(seed), sea.image.copy(), sea.truth.copy()
    taken = cv2.dilate((sea.objects > 0).astype(np.uint8), np.ones((41, 41), np.uint8)) > 0
    half, found, queue, gain = OUTLINE_SIDE // 2, [], [], sea.sensor.well / sea.sensor.levels
    dark = (sea.sensor.read_noise / gain) ** 2 + 1 / 12  # variance of digital numbers at 0
    for row in range(20, image.shape[1] - 20, step):
        for column in range(20, image.shape[2] - 20, step):
            if taken[row, column]:
                continue
            queue = queue or [kinds[i] for i in rng.permutation(len(kinds))]
            colour, size = queue.pop()
            down, right = (rng.integers(-2, 3, 2) / 4).tolist() if seed % 2 else (0.0, 0.0)
            part = outline(sea.sensor, size, down, right, speed)
            place = slice(None), slice(row - half, row + half + 1), slice(column - half, column + half + 1)
            own = (reflectance(colour, sea.sensor) * white(sea.sensor))[:, None, None]
            clean = (sea.truth[place] + sea.glint[place]) * (1 - part) + part * own
            noisy = clean + np.sqrt(dark + 1 / gain * clean) * rng.standard_normal(clean.shape)
            image[place] = np.where(part > 2e-3, np.clip(np.rint(noisy), 0, sea.sensor.levels), image[place])
            truth[place] = truth[place] * (1 - part) + part * own
            found.append(Target(colour, size, row, column))
    return replace(sea, image=image, truth=truth), found


def contrast(clean: Image, without: Image, truth: Image, targets: Sequence[Target], sensor: Sensor = SENSOR) -> Image:
    """Share of its contrast that each target keeps in image `clean`, given the truth without and with targets."""
    out = []
    for t in targets:
        place = slice(VISIBLE_BANDS), slice(t.row - 5, t.row + 7), slice(t.column - 5, t.column + 7)
        lit = white(sensor)[:VISIBLE_BANDS, None, None]
        wanted, is_left = (truth[place] - without[place]) / lit, (clean[place] - without[place]) / lit
        counts = np.abs(wanted) > 0.25 * np.abs(wanted).max()
        out.append((is_left * wanted)[counts].sum() / (wanted[counts] ** 2).sum())
    return np.array(out)


def shared(name: str) -> Sea:
    """A recorded scene, which lies beside the project, by its name."""
    return _sea(DATA / "simulated" / f"{name}.tif")


def simulated(place: Path, wind: float, patch: float, seed: int, sensor: Sensor = SENSOR) -> Sea:
    """Simulate a scene into folder `place`, with squares under water if pixels are smaller than 0.5 m."""
    path = place / f"{sensor.name}-{wind:g}-{patch:g}-{seed}.tif"
    squares = thesis_array((384, 384), sensor.gsd) if sensor.gsd < 0.5 else ()
    sea = {"wind": wind, "patch": patch, "seed": seed, "sky": "cardioidal"}
    write_scene(simulate(Setup(sensor=sensor, size=(384, 384), objects=squares, **sea), workers=2), path)
    return _sea(path, sensor)


def _sea(path: Path, sensor: Sensor = SENSOR) -> Sea:
    parts = [values(path.with_stem(path.stem + e)) for e in ("", "_truth", "_glint")]
    image, truth, glint = (p / scale(sensor) for p in parts)
    objects = plane(path.with_stem(f"{path.stem}_objects"))
    return Sea(path, np.rint(image), truth, glint, objects, sensor)


def write(sea: Sea, path: Path) -> None:
    """Write the sea's image to `path`, in a copy of the sea's own file."""
    shutil.copyfile(sea.path, path)
    with rasterio.open(path, "r+") as out:
        out.write(np.clip(sea.image, 0, sea.sensor.levels).astype(out.dtypes[0]))


def survive(shares: Image) -> float:
    """Share of the targets that keep 80 to 125 % of their contrast."""
    return float(((shares >= LEAST_KEPT) & (shares <= MOST_KEPT)).mean())
