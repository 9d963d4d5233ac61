"""System effects one at a time: error and objects found against noise, f-number, smear and band delay.

`python -m benchmarks effects [--quick]`. Scenes as those of `rxdetect bench`, 9 m/s.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from statistics import mean

from deglint.physics.presets import preset
from deglint.physics.sensor import Sensor
from detect.bench.run import DEFAULT, Effort, Results, cleaned, quality
from detect.bench.scenes import simulated

from .timing import say

WIND = 9.0


def sensors() -> dict[str, Sensor]:
    """The sensor of the thesis with one effect changed in each, and all bands at one instant but for the delays."""
    base = preset("thesis").delayed(0.0)
    return {
        "as in the thesis, no delay": base,
        "4 times the noise": replace(base, well=base.well / 16, read_noise=base.read_noise / 4),
        "f/2": replace(base, f_number=2.0),
        "f/30": replace(base, f_number=30.0),
        "no smear": replace(base, smear=0.0),
        "smear of 2 pixels": replace(base, smear=2.0),
        "delay 10 ms": preset("thesis").delayed(0.010),
        "delay 60 ms": preset("thesis").delayed(0.060),
    }


def main(quick: bool) -> None:
    """Print one row for each sensor: error, and objects of 2 % found, after joyce and after the default."""
    names, seeds = ("joyce", DEFAULT), 1 if quick else 5
    chosen = sensors()
    rows: list[list[str]] = []
    found: dict[tuple[str, str], list[tuple[float, float]]] = {}
    with tempfile.TemporaryDirectory() as place:
        for seed in range(seeds):
            for label, scene in zip(chosen, simulated(Path(place), chosen.values(), WIND, seed), strict=True):
                images = {"raw": scene.raw} | cleaned(scene, Results(Effort(names)))
                for name, image in images.items():
                    seen = quality(scene, image)
                    found.setdefault((label, name), []).append((seen.whole, 100 * float(seen.found[0])))
    for label in chosen:
        cells = [f"{mean(values):.3g}" for name in ("raw", *names) for values in zip(*found[label, name], strict=True)]
        rows.append([label, *cells])
    head = ("", *(f"{what}, {name} [%]" for name in ("raw", *names) for what in ("error", "found")))
    say(f"System effects at {WIND:g} m/s", head, rows, f"Mean over seeds ({seeds}); objects of 2 % reflectance.")
