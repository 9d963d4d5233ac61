"""Contrast that `deglint remove` leaves to ships of real scenes, and to targets that are put into their water."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import rasterio

from deglint import Recipe
from deglint.masks import Roles, fit_water, water
from deglint.masks.sample import deep_water, fit_sample

from .files import plane, removed, values
from .implants import GRID_STEP, SIZES, Image, survive
from .timing import say

Mask = npt.NDArray[np.bool_]
SCENE_TARGETS = 24
"""Approximate number of targets in a scene."""
HARBOUR_RECIPES = {
    "hedley": Recipe(method="hedley", nir=("B08",), mask="none", compensate="off"),
    "deglint remove": Recipe(nir=("B08",)),
}
"""Hedley's method as published, and the default."""


def kept(folder: Path, name: str, recipe: Recipe) -> tuple[Image, Image]:
    """Share of its contrast that each ship keeps, (ship, band), and noise of deep water, (band,): B02, B03, B04.

    A labelled ship counts if at least a third of the ring 5 to 15 pixels from its brightest pixel is water.
    """
    image = values(folder / f"{name}.tif")
    labels = plane(folder / f"{name}_ships.tif").astype(int)
    sea = water(image, rule := fit_water([image], Roles(nir=3, blue=0, green=1, red=2)))
    clean = removed(folder / f"{name}.tif", recipe)
    pairs = [[_contrast(i, labels, sea, n) for i in (image, clean)] for n in range(1, labels.max() + 1)]
    before, after = np.array([p for p in pairs if p[0] is not None], np.float64).swapaxes(0, 1)
    return after / before, _noise(clean, deep_water(image, fit_sample([image], rule)))


def _contrast(image: Image, labels: npt.NDArray[Any], sea: Mask, number: int) -> Image | None:
    """Brightest pixel of a ship minus the median of the water 5 to 15 pixels away, (band,); None without such water."""
    rows, columns = np.nonzero(labels == number)
    if not rows.size:
        return None
    out = []
    for band in image[:3]:
        at = int(np.argmax(band[rows, columns]))
        y, x = np.ogrid[: labels.shape[0], : labels.shape[1]]
        away = np.hypot(y - rows[at], x - columns[at])
        ring = (away >= 5) & (away <= 15) & (labels != number)
        if 3 * (sea & ring).sum() < ring.sum():
            return None
        out.append(band[rows, columns].max() - np.median(band[ring & sea]))
    return np.array(out)


def _noise(image: Image, deep: Mask) -> Image:
    """Standard deviation of deep water from its local mean (31 x 31 pixels), without the largest 0.01 %, (band,)."""

    def box(values: Image) -> Image:
        return cv2.boxFilter(values, -1, (31, 31), normalize=False, borderType=cv2.BORDER_CONSTANT)

    count, out = np.maximum(box(deep.astype(np.float64)), 1), []
    for band in image[:3]:
        away = (band - box(np.where(deep, band, 0.0)) / count)[deep]
        out.append(away[np.abs(away) <= np.quantile(np.abs(away), 0.9999)].std())
    return np.array(out)


def ships(folder: Path) -> None:
    """Print the contrast that the ships of two harbours keep."""
    rows = []
    for name in ("casablanca", "honolulu"):
        for label, recipe in HARBOUR_RECIPES.items():
            shares, noise = kept(folder, name, recipe)
            left = [f"{np.median(s):.2f} / {(s >= 0.8).mean():.2f}" for s in shares.T]
            rows.append([f"{name}, {len(shares)} ships", label, *left, *(f"{x:.1f}" for x in noise)])
    note = "Median share of contrast left / share of ships that keep 80 %; noise of deep water [DN]."
    say("Contrast of ships", ("", "", "B02", "B03", "B04", "noise B02", "B03", "B04"), rows, note)


def targets(folder: Path) -> None:
    """Put grey squares, not blurred, into the water of real scenes, and print the contrast that they keep."""
    rows = []
    few, many = Roles(nir=3, blue=0, green=1, red=2), Roles(nir=7, blue=1, green=2, red=3)
    for name, unit, roles in (("casablanca", 65535, few), ("honolulu", 65535, few), ("palau", 10000, many)):
        image = values(folder / f"{name}.tif")
        places = _places(water(image, fit_water([image], roles)))
        empty = {label: removed(folder / f"{name}.tif", recipe) for label, recipe in HARBOUR_RECIPES.items()}
        for reflectance in (0.05, 0.1, 0.3):
            cells = []
            with tempfile.TemporaryDirectory() as scratch:
                path = Path(scratch) / f"{name}.tif"
                there = _planted(folder / f"{name}.tif", path, places, round(reflectance * unit))
                for label, recipe in HARBOUR_RECIPES.items():
                    clean = removed(path, recipe)
                    shares = [
                        [(clean[b][p] - empty[label][b][p]).mean() / (there[b][p] - image[b][p]).mean()
                         for b in (roles.blue, roles.green, roles.red)] for p in places
                    ]  # fmt: skip
                    cells.append(f"{np.median(shares):.2f} / {survive(np.array(shares).ravel()):.2f}")
            rows.append([name, f"{100 * reflectance:g} %", str(len(places)), *cells])
    note = "Median share of contrast left / share that keeps 80 to 125 %, over B02, B03, B04."
    say("Targets of 1 to 5 pixels in real water", ("", "reflectance", "targets", *HARBOUR_RECIPES), rows, note)


def _places(sea: Mask) -> list[tuple[slice, slice]]:
    """Places of about `SCENE_TARGETS` targets, on a grid and at least 8 pixels from land: they cover little water."""
    corners = [
        (row, column)
        for row in range(20, sea.shape[0] - 20, GRID_STEP)
        for column in range(20, sea.shape[1] - 20, GRID_STEP)
        if sea[row - 8 : row + 9, column - 8 : column + 9].all()
    ]
    out = []
    for i, (row, column) in enumerate(corners[:: max(len(corners) // SCENE_TARGETS, 1)]):
        size = SIZES[i % len(SIZES)]
        out.append((slice(row, row + size), slice(column, column + size)))
    return out


def _planted(source: Path, path: Path, places: Sequence[tuple[slice, slice]], value: int) -> Image:
    """Write a copy of a file with `value` in all bands at the places. Return its physical values."""
    shutil.copyfile(source, path)
    with rasterio.open(path, "r+") as out:
        counts = out.read()
        for place in places:
            counts[(slice(None), *place)] = value
        out.write(counts)
    return values(path)
