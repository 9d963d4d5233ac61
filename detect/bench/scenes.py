"""Simulated scenes whose truth is known.

The left half is deep water, the sample to which every removal is fitted. The right half has submerged squares of 4 m by
4 m at a depth of 5 m, one column for each reflectance. The sky is cardioidal and has no glow around the sun, because
the reflection of a glow would be part of the truth, and no method could distinguish this reflection from glint.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from deglint import Scene, open_scene
from deglint.morphology import grown
from deglint.physics.sensor import Sensor
from deglint.simulate import Setup, SimulatedScene, simulate_together, thesis_array

from ..arrays import Array, Float64, Int64, Mask

SIDE = 256  # number of rows and of columns of a scene [pixel of 25 cm]
REFLECTANCES = (0.02, 0.05, 0.10, 0.20)  # reflectances of the submerged objects [1]
OBJECT, DEPTH = 16, 5.0  # side of an object [pixel] and its depth [m]
BLURRED_EDGE = 4  # width of the edge of objects that is neither object nor background [pixel]: light is spread there
SEED = 100  # seed of the first sea


@dataclass(frozen=True, eq=False)
class TrueScene:
    """A simulated scene in a file, and its truth; images are (band, row, column) [W m-2 sr-1 nm-1]."""

    made: SimulatedScene
    file: Path

    def radiance(self, counts: Array) -> Float64:
        """Convert digital numbers of the sensor, (band, row, column), to radiance [W m-2 sr-1 nm-1]."""
        sensor = self.made.setup.sensor
        return np.asarray(counts * np.array([sensor.scale(b) for b in sensor.bands])[:, None, None])

    @cached_property
    def scene(self) -> Scene:
        """The file of the image with glint and noise, opened by `deglint.open_scene`."""
        return open_scene(str(self.file))

    @property
    def deep(self) -> slice:
        """Columns of the deep water, the sample to which every removal is fitted."""
        return slice(self.made.setup.size[1] // 2)

    @property
    def sample(self) -> Mask:
        """Mask of the deep water, (row, column)."""
        mask = np.zeros(self.made.setup.size, np.bool_)
        mask[:, self.deep] = True
        return mask

    @cached_property
    def kinds(self) -> Int64:
        """Kind of each pixel, (row, column): 0 background, -1 blurred edge, 1 + index in `REFLECTANCES` for objects."""
        labels = self.made.objects.astype(np.int64)
        near = grown(labels > 0, 2 * BLURRED_EDGE + 1)
        return np.where(labels > 0, (labels - 1) % len(REFLECTANCES) + 1, np.where(near, -1, 0))


def simulated(directory: Path, sensors: Iterable[Sensor], wind: float, seed: int, side: int = SIDE) -> list[TrueScene]:
    """Simulate a sea of `side` x `side` pixels at a wind [m/s]; return one scene per sensor, written to `directory`."""
    from deglint.raster.simulated import write_scene

    largest, setups = min(OBJECT, side / 4 / len(REFLECTANCES)), []
    for s in sensors:
        squares = thesis_array((side, side), s.gsd, reflectances=REFLECTANCES, sides=(largest,), depth=DEPTH)
        setup = Setup(sensor=s, size=(side, side), wind=wind, sky="cardioidal", objects=squares, seed=SEED + seed)
        setups.append(setup)
    made = enumerate(simulate_together(setups))
    return [TrueScene(one, write_scene(one, directory / f"sea{n}", overwrite=True, truth=False)[0]) for n, one in made]
