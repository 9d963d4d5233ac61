"""Do small bright things survive `deglint remove`? Targets put into scenes, and ships of real scenes, end to end.

A target survives where 80 to 125 % of its contrast is left (see `benchmarks.implants`). Between them, "raw" is the
limit: there sparkle beside a target adds to it.
"""

from __future__ import annotations

import json
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from deglint import open_scene, remove_glint
from deglint.compensate.evidence import Protection
from deglint.pipeline import compensation
from detect.bench.measure import rms_error

from .compensation import changed
from .error import DATA, DEEP
from .implants import COLOURS, SCALE, SIZES, STEP, Array, Sea, contrast, implant, shared, simulated, survive, write
from .timing import machine, say

BESIDE = 0.02
"""Of the water level, that a target may add where none is."""
DEGLINTED, UNPROTECTED = "deglint remove", "nothing put back"


def deglinted(sea: Sea, place: Path, protect: bool = True) -> tuple[Array, float | None]:
    """What `deglint remove` makes of a scene, in digital numbers, and its threshold on sums of S."""
    write(sea, place / "in.tif")
    off = changed(compensation, "_protection", lambda *_: Protection(reason="left out to compare"))
    with off if not protect else changed(compensation, "BLURRED", compensation.BLURRED):
        remove_glint(place / "in.tif", place / "out.tif", overwrite=True)
    told = json.loads((place / "out.tif.json").read_text())["compensation"]["protection"]
    return open_scene(place / "out.tif").read().astype(np.float64) / SCALE, told["threshold"]


def groups(place: Path, quick: bool) -> Iterator[tuple[str, list[Sea]]]:
    """Scenes of a kind: name, and the seas."""
    if (DATA / "simulated").exists():
        for name in ("wind05_delay60", "wind09_delay60"):
            yield name, [shared(name)]
    for patch in (0.005, 0.06):
        for wind in (5.0, 9.0):
            seeds = range(101, 102 if quick else 104)
            yield f"simulated, {wind:g} m/s, patch {patch:g}", [simulated(place, wind, patch, s) for s in seeds]


def errors(image: Array, truth: Array, without: Array | None = None) -> Array:
    """Of deep water and of the whole crop [%]; only where no target is, where the truth without them is given."""
    if without is not None:
        beside = np.abs(truth - without) < BESIDE * np.median(truth, axis=(1, 2), keepdims=True)
        image = np.where(beside, image, truth)
    return np.array([rms_error(image, truth, columns) for columns in (slice(DEEP), slice(None))])


def survivors(place: Path, quick: bool) -> None:
    """Error without and with targets, and share of targets that survive."""
    kinds = [(c, s) for c in COLOURS for s in SIZES]
    table, rows = [], []
    for name, seas in groups(place, quick):
        left: dict[str, dict[tuple[str, bool], list[float]]] = defaultdict(lambda: defaultdict(list))
        found: dict[str, list[Array]] = defaultdict(list)
        thresholds = []
        for sea in seas:
            found["plain"].append(errors(deglinted(sea, place, protect=False)[0], sea.truth))
            clean, threshold = deglinted(sea, place)
            found["alone"].append(errors(clean, sea.truth))
            thresholds.append(np.inf if threshold is None else threshold)
            for seed in range(2 if quick else 4):
                there, targets = implant(sea, kinds, seed)
                results = {"raw": there.image, DEGLINTED: deglinted(there, place)[0]}
                if seed == 0:
                    results[UNPROTECTED] = deglinted(there, place, protect=False)[0]
                found["raw with"].append(errors(there.image, there.truth, sea.truth))
                found["with"].append(errors(results[DEGLINTED], there.truth, sea.truth))
                for label, image in results.items():
                    for t, share in zip(targets, contrast(image, sea.truth, there.truth, targets), strict=True):
                        left[label][t.colour, t.size > 1].append(share)
        cells = ["{:.2f} / {:.2f}".format(*np.mean(found[k], axis=0)) for k in ("plain", "alone", "raw with", "with")]
        table.append([name, *cells, f"{np.mean(thresholds):.0f}"])
        for label, shares in left.items():
            cells = [
                f"{survive(np.array(shares[c, True])):.2f} / {survive(np.array(shares[c, False])):.2f}" for c in COLOURS
            ]
            rows.append([name, label, *cells])
    note = "Deep water / whole crop, in percent of the water level; in scenes with targets the water beside them alone."
    head = "", f"without targets, {UNPROTECTED}", f"without, {DEGLINTED}", "with, raw", f"with, {DEGLINTED}"
    say("Error [%], and threshold", (*head, "threshold"), table, note)
    note = "Share that keeps 80 to 125 % of its contrast: targets of 2, 3 and 5 pixels / of 1 pixel."
    say("Targets that survive", ("", "", *COLOURS), rows, note)


def moving(place: Path, quick: bool) -> None:
    """Targets that move while the bands look one after the other."""
    rows, kinds = [], [("white 30 %", 2), ("white 30 %", 3), ("white 30 %", 5)]
    for name, seas in groups(place, True):
        for speed in (0.5, 1.0, 2.0) if quick else (0.25, 0.5, 1.0, 2.0, 4.0):
            there, targets = implant(seas[0], kinds, 1, speed, 2 * STEP)
            shares = contrast(deglinted(there, place)[0], seas[0].truth, there.truth, targets)
            cells = [
                f"{survive(np.array([x for t, x in zip(targets, shares, strict=True) if t.size == s])):.2f}"
                for s in (2, 3, 5)
            ]
            rows.append([name, f"{speed:g}", *cells])
    say("White (30 %) targets that move and survive", ("", "m/s", "2 pixels", "3", "5"), rows)


def main(quick: bool) -> None:
    """Measure and print."""
    from .harbours import ships, targets

    print("## Small things\n\n" + machine())
    for part in (survivors, moving):
        with tempfile.TemporaryDirectory() as name:
            part(Path(name), quick)
    if (DATA / "sentinel2" / "casablanca.tif").exists():
        ships(DATA / "sentinel2")
        targets(DATA / "sentinel2")
    else:
        print("\nSkipped: the real scenes do not lie beside the project.")
