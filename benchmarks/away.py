"""Never worse than doing nothing: every band by default beside the raw one, from looks away from the glint into it.

Grids of squares, discs and diamonds at 5 m depth, as `scenes` has them, under a cardioidal sky; each scene also
without its glint.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from deglint.physics.presets import preset
from deglint.raster.simulated import write_scene
from deglint.simulate import Setup, SimulatedScene, simulate, simulate_together
from detect.bench.measure import VISIBLE_BANDS

from .error import DEEP
from .files import values
from .scenes import SIDE, deglinted, objects
from .timing import machine, say

WINDS = (2.0, 5.0, 9.0, 12.0)
LOOKS = ((60.0, 0.0), (40.0, 0.0), (30.0, 0.0), (20.0, 0.0), (10.0, 0.0), (0.0, 0.0), (40.0, 90.0), (20.0, 180.0))
"""View zenith angle, and azimuth of the sensor from that of the sun (180: into the glint), as seen from the target."""
DELAYS = (0.0, 0.01, 0.02, 0.06)
SENSORS = ("thesis", "thesis-f30")
PATCHES = (0.06, 0.005)
KINDS = ("square", "disc", "diamond")
HALF = SIDE // 2
"""Columns with glint, where there is some in the left half alone."""
BESIDE, INSIDE = 104, 42
"""Pixels on either side of where it ends that are not counted to the part without, and to the part with it."""
WORSE = 1.01
"""An error that many times the raw one is worse."""


def scenes(wind: float, look: tuple[float, float], patch: float, seed: int, *, quick: bool) -> Iterator[SimulatedScene]:
    """What sensors with these delays and optics see of one sea."""
    base = Setup(size=(SIDE, SIDE), wind=wind, sky="cardioidal", patch=patch, seed=seed, objects=objects(*KINDS),
                 view_zenith=look[0], view_azimuth=(Setup.sun_azimuth + look[1]) % 360)  # fmt: skip
    if quick:
        yield simulate(replace(base, sensor=preset("thesis").delayed(DELAYS[-1])))
        return
    yield from simulate_together([replace(base, sensor=preset(s).delayed(d)) for d in DELAYS for s in SENSORS])


def errors(image: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Of deep water and of the whole, band by band, in percent of the water level."""
    away, level = image - truth, np.median(truth, axis=(1, 2))
    return np.array([100 * np.sqrt((a**2).mean(axis=(1, 2))) / level for a in (away[:, :, :DEEP], away)])


def measure(place: Path, scene: SimulatedScene, glint: int = SIDE) -> tuple[np.ndarray, np.ndarray]:
    """What is seen, and what is left of it by default, where there is glint as far as this column."""
    image = scene.image.copy()
    image[:, :, glint:] = scene.truth_image[:, :, glint:]
    write_scene(replace(scene, image=image), place / "away", overwrite=True, truth=False)
    return values(place / "away.tif"), deglinted(place / "away.tif")[0]


def visible(found: Sequence[np.ndarray]) -> str:
    """Mean error of the visible bands over scenes, of deep water and of the whole, as text."""
    each = np.sqrt((np.array(found)[:, :, :VISIBLE_BANDS] ** 2).mean(axis=2)).mean(axis=0)
    return f"{each[0]:.2f} / {each[1]:.2f}"


def told(ratios: Sequence[np.ndarray]) -> tuple[str, str]:
    """How many errors are worse than the raw ones, and the largest of that."""
    return f"{int((np.array(ratios) > WORSE).sum())} of {np.size(ratios)}", f"{np.max(ratios):.3f}"


def row(found: Iterable[SimulatedScene], place: Path) -> list[str]:
    """Cells of a row, over the scenes of a wind and a look."""
    raws, cleans, calms, ratios, halves, parts = [], [], [], [], [], []
    far, lit = np.s_[:, :, HALF + BESIDE :], np.s_[:, :, : HALF - INSIDE]
    for scene in found:
        truth = scene.truth.astype(np.float64)
        (raw, clean), (before, calm), (part_raw, part) = (measure(place, scene, reach) for reach in (SIDE, 0, HALF))
        raws.append(errors(raw, truth))
        cleans.append(errors(clean, truth))
        calms.append(errors(calm, truth))
        ratios += [cleans[-1] / raws[-1], calms[-1] / errors(before, truth)]
        halves.append(errors(part[far], truth[far])[1] / errors(part_raw[far], truth[far])[1])
        parts.append([errors(image[lit], truth[lit])[1] for image in (part, clean)])
    return [*map(visible, (raws, cleans, calms)), *told(ratios), *told(halves), visible(parts)]


def main(quick: bool) -> None:
    """Measure and print."""
    print("## Never worse\n\n" + machine())
    winds, looks, patches = (WINDS[1:2], LOOKS[1::4], PATCHES[:1]) if quick else (WINDS, LOOKS, PATCHES)
    rows = []
    with tempfile.TemporaryDirectory() as name:
        for wind, look in product(winds, looks):
            found = (scene for patch in patches for scene in scenes(wind, look, patch, 0, quick=quick))
            rows.append([f"{wind:g}", f"{look[0]:g}, {look[1]:g}", *row(found, Path(name))])
    head = ("wind [m/s]", "look, azimuth from the sun", "raw [%]", "by default [%]", "without glint [%]", "worse",
            "largest error, of the raw one", "worse in the half without glint", "largest there",
            "the half with glint, alone / of the whole [%]")  # fmt: skip
    delays = ", ".join(f"{1000 * d:g}" for d in (DELAYS[-1:] if quick else DELAYS))
    sizes = ", ".join(f"{p:g}" for p in patches)
    note = (
        f"Deep water / whole, mean over delays of {delays} ms, optics {', '.join(SENSORS[: 1 if quick else 2])}, and "
        f"patches of {sizes} m. Worse: errors of a band, deep or whole, with glint or without, more than "
        f"{WORSE - 1:.0%} above the raw ones. Of scenes with glint in their left half, errors of bands from {BESIDE} "
        f"pixels beside it on; and the mean error of what lies {INSIDE} pixels and more within it, beside that of the "
        "same where there is glint everywhere."
    )
    say("Every band beside the raw one", head, rows, note)
