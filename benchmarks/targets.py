"""Do small bright targets survive `deglint remove`? Targets are put into scenes; ships of real scenes are compared.

A target survives if it keeps 80 to 125 % of its contrast (see `benchmarks.implants`). Rows "raw" show what is possible:
without removal, too, sparkle changes the contrast. A parameter `chain` is a function that removes the glint of a sea;
it gets the sea and a folder, and returns the image in digital numbers.
"""

from __future__ import annotations

import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from deglint import remove_glint
from deglint.physics.presets import preset

from .error import whole_and_deep
from .files import DATA, values
from .implants import COLOURS, GRID_STEP, SIZES, Image, Sea, contrast, implant, scale, shared, simulated, survive, write
from .timing import machine, say

Chain = Callable[[Sea, Path], Image]

BESIDE = 0.02
"""A pixel is beside the targets if they change its radiance by less than this share of the water's."""


def deglinted(sea: Sea, place: Path) -> Image:
    """Remove the glint of a scene by default, with files in folder `place`. Return the image in digital numbers."""
    write(sea, place / "in.tif")
    remove_glint(place / "in.tif", place / "out.tif", overwrite=True)
    return values(place / "out.tif") / scale(sea.sensor)


def groups(place: Path, quick: bool) -> Iterator[tuple[str, list[Sea]]]:
    """Name and seas of each group of scenes: recorded ones, and simulated ones by sensor, patch and wind."""
    if (DATA / "simulated").exists():
        for name in ("wind05_delay60", "wind09_delay60"):
            yield name, [shared(name)]
    seeds = range(101, 102 if quick else 104)
    for sensor, patch in ((preset(n), p) for n, p in (("thesis", 0.005), ("thesis", 0.06), ("worldview3", 0.06))):
        for wind in (5.0, 9.0):
            name = f"{sensor.gsd:g} m, {wind:g} m/s, patch {patch:g}"
            yield name, [simulated(place, wind, patch, seed, sensor) for seed in seeds]


def errors(image: Image, truth: Image, without: Image | None = None) -> Image:
    """Errors of deep water and whole image [%]; given the truth `without` targets, their pixels count as right."""
    if without is not None:
        beside = np.abs(truth - without) < BESIDE * np.median(truth, axis=(1, 2), keepdims=True)
        image = np.where(beside, image, truth)
    return np.array(whole_and_deep(image, truth)[::-1])


def survivors(place: Path, quick: bool, chain: Chain = deglinted) -> None:
    """Print the errors without and with targets, and the share of targets that survive, by colour and size."""
    kinds = [(c, s) for c in COLOURS for s in SIZES]
    table, rows = [], []
    for name, seas in groups(place, quick):
        left: dict[str, dict[tuple[str, bool], list[float]]] = defaultdict(lambda: defaultdict(list))
        found: dict[str, list[Image]] = defaultdict(list)
        for sea in seas:
            found["alone"].append(errors(chain(sea, place), sea.truth))
            for seed in range(2 if quick else 4):
                there, targets = implant(sea, kinds, seed)
                for label, image in {"raw": there.image, "deglint remove": chain(there, place)}.items():
                    found[label].append(errors(image, there.truth, sea.truth))
                    shares = contrast(image, sea.truth, there.truth, targets, sea.sensor)
                    for t, share in zip(targets, shares, strict=True):
                        left[label][t.colour, t.size > 1].append(share)
        means = [np.mean(found[k], axis=0) for k in ("alone", "raw", "deglint remove")]
        table.append([name, *("{:.2f} / {:.2f}".format(*pair) for pair in means)])
        for label, shares in left.items():
            cells = [[survive(np.array(shares[c, larger])) for larger in (True, False)] for c in COLOURS]
            rows.append([name, label, *("{:.2f} / {:.2f}".format(*cell) for cell in cells)])
    note = "Deep water / whole crop, in percent of the water's radiance; with targets the water beside them alone."
    say("Error [%]", ("", "without targets", "with, raw", "with, deglint remove"), table, note)
    note = "Share that keeps 80 to 125 % of its contrast: targets of 2, 3 and 5 pixels / of 1 pixel."
    say("Targets that survive", ("", "", *COLOURS), rows, note)


def moving(place: Path, quick: bool, chain: Chain = deglinted) -> None:
    """Print the share of targets that survive if they move while the bands are taken one after the other."""
    rows, kinds = [], [("white 30 %", 2), ("white 30 %", 3), ("white 30 %", 5)]
    for name, seas in groups(place, True):
        for speed in (0.5, 1.0, 2.0) if quick else (0.25, 0.5, 1.0, 2.0, 4.0):
            there, targets = implant(seas[0], kinds, 1, speed, 2 * GRID_STEP)
            shares = contrast(chain(there, place), seas[0].truth, there.truth, targets, seas[0].sensor)
            by_size = [[x for t, x in zip(targets, shares, strict=True) if t.size == s] for s in (2, 3, 5)]
            rows.append([name, f"{speed:g}", *(f"{survive(np.array(x)):.2f}" for x in by_size)])
    say("White (30 %) targets that move and survive", ("", "m/s", "2 pixels", "3", "5"), rows)


def main(quick: bool) -> None:
    """Print the tables of simulated targets, and of ships and targets in real scenes."""
    from .harbours import ships, targets

    print("## Small targets\n\n" + machine())
    for part in (survivors, moving):
        with tempfile.TemporaryDirectory() as name:
            part(Path(name), quick)
    if (DATA / "sentinel2" / "casablanca.tif").exists():
        ships(DATA / "sentinel2")
        targets(DATA / "sentinel2")
    else:
        print("\nSkipped: the real scenes do not lie beside the project.")
