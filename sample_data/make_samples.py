"""Make the sample scenes sea_025m and sea_1m, with their truth, beside this file: `python sample_data/make_samples.py`.

Both show a reef edge, targets under water, a boat under way and (at 0.25 m) swimmers, under sun glint. Bands are not
simultaneous: 60 ms from band to band at 0.25 m, WorldView-3's delays at 1.24 m. The same files come out each time.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from deglint.physics.presets import preset
from deglint.raster.simulated import write_scene
from deglint.simulate import Bottom, FloatingTarget, Setup, SubmergedObject, simulate, square

PARTS = ("_truth", "_truth_water", "_objects", "_cover")
DIGITS = 9
"""Binary digits that the truths keep, so that they compress: to 0.2 %, below the noise of the sensor."""


def plank(right: float, down: float, length: float, width: float, turn: float, depth: float) -> SubmergedObject:
    """A long target under water by its middle and size [m], turned clockwise from east [degree]."""
    along = np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))]) * length / 2
    across = np.array([-along[1], along[0]]) * width / length
    middle = np.array([right, down])
    corners = (middle + along + across, middle + along - across, middle - along - across, middle - along + across)
    outline = tuple((float(x), float(y)) for x, y in corners)
    return SubmergedObject(corners=outline, reflectance=0.25, depth=depth)


def sea_025m() -> Setup:
    """84 m of sea in pixels of 0.25 m, as an aircraft sees it."""
    swimmers = (
        (9.0, 52.0, 80.0, "skin"), (13.0, 56.0, 100.0, "orange"), (11.0, 61.0, 60.0, "skin"),
        (30.0, 74.0, 20.0, "orange"), (44.0, 12.0, 180.0, "skin"),
    )  # fmt: skip
    targets = tuple(
        FloatingTarget(right=x, down=y, length=1.2, width=0.7, speed=0.5, heading=heading, material=material)
        for x, y, heading, material in swimmers
    )
    boat = FloatingTarget(right=30.0, down=32.0, length=8.0, width=2.6, speed=4.0, heading=65.0, wake=14.0)
    squares = ((10.0, 10.0, 6.0, 0.30), (20.0, 10.0, 5.0, 0.25), (29.0, 10.0, 4.0, 0.20))
    return Setup(
        sensor=preset("thesis").delayed(0.060),
        size=(336, 336),
        wind=6.0,
        wind_from=20.0,
        objects=(
            *(square(x, y, side, reflectance=reflectance, depth=5.0) for x, y, side, reflectance in squares),
            plank(37.0, 66.0, 14.0, 4.4, -20.0, 5.0),
        ),
        targets=(boat, *targets),
        bottom=Bottom(
            depth=(30.0, 5.0), edge=(58.0, 12.0), roughness=0.5, share=0.35, patch=20.0, materials=("sand", "coral")
        ),
        seed=11,
    )


def sea_1m() -> Setup:
    """317 m of sea in pixels of 1.24 m, as WorldView-3 sees it."""
    squares = ((40.0, 40.0, 20.0, 0.25), (90.0, 40.0, 12.0, 0.25), (40.0, 90.0, 20.0, 0.10), (90.0, 90.0, 12.0, 0.10))
    boats = (
        FloatingTarget(right=140.0, down=120.0, length=24.0, width=6.0, speed=6.0, heading=65.0, wake=40.0),
        FloatingTarget(right=60.0, down=200.0, length=9.0, width=3.0, speed=8.0, heading=130.0, wake=24.0),
        FloatingTarget(right=150.0, down=240.0, length=6.0, width=2.4, heading=20.0),
    )
    return replace(
        sea_025m(),
        sensor=preset("worldview3"),
        size=(256, 256),
        wind=8.0,
        objects=(
            *(square(x, y, side, reflectance=reflectance, depth=6.0) for x, y, side, reflectance in squares),
            plank(150.0, 270.0, 60.0, 10.0, -20.0, 6.0),
        ),
        targets=boats,
        bottom=Bottom(
            depth=(35.0, 5.0), edge=(210.0, 40.0), roughness=1.0, share=0.4, patch=60.0, materials=("sand", "coral")
        ),
    )


def rounded(values: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
    """Numbers rounded to `DIGITS` binary digits."""
    mantissa, exponent = np.frexp(values)
    return np.ldexp(np.rint(mantissa * 2.0**DIGITS) / 2.0**DIGITS, exponent).astype(np.float32)


def main(directory: Path) -> None:
    """Simulate and write both scenes."""
    for name, setup in (("sea_025m", sea_025m()), ("sea_1m", sea_1m())):
        scene = simulate(setup, workers=2)
        scene = replace(scene, truth=rounded(scene.truth), truth_water=rounded(scene.truth_water))
        for path in write_scene(scene, directory / name, overwrite=True, truth=PARTS):
            sys.stdout.write(f"{path} {path.stat().st_size / 1024:.0f} KiB\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
