"""Opaque cover of the sea: land, foam, and floating targets that move.

The cover is Lambertian: it reflects neither sun nor sky specularly, and no light from the water passes through it.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from .setup import FloatingTarget, Setup
from .underwater import smooth_noise

Labels = npt.NDArray[np.unsignedinteger[Any]]

OPEN_WATER, LAND, FOAM, TARGET = range(4)  # values of the cover raster `SimulatedScene.cover`
FOAM_PATCH = 1.5  # size of a patch of foam [m]: a spilling breaker of short wind waves
LAND_PATCH = 6.0  # size of the patches of vegetation and rock on land [m]
BASE = ("", "vegetation", "rock", "foam")  # materials of labels 0 (water) to 3; one label for each target follows


class Cover:
    """Land, foam and floating targets of a setup. The label of a facet is the index of its material in `materials`."""

    def __init__(self, setup: Setup) -> None:
        shape = setup.fine_grid
        self.setup = setup
        self.materials = (*BASE, *(target.material for target in setup.targets))
        self._fixed = np.zeros(shape, np.uint16)
        land, foam, self._speckle = np.random.SeedSequence(setup.seed, spawn_key=(4,)).spawn(3)
        if setup.foam > 0:
            field = smooth_noise(shape, setup.facet, 6 * FOAM_PATCH, foam.spawn(1)[0])
            field += smooth_noise(shape, setup.facet, FOAM_PATCH, foam)
            self._fixed[field > np.quantile(field, 1.0 - setup.foam)] = 3
        if setup.coast > 0:
            self._add_land(land)

    def _add_land(self, seed: np.random.SeedSequence) -> None:
        """Add patches of vegetation and rock behind a curved shore, along the right edge of the image."""
        setup, shape = self.setup, self._fixed.shape
        bend, patches = seed.spawn(2)
        width = setup.size[1] * setup.sensor.gsd
        shore = width - setup.coast * (1.0 + 0.3 * smooth_noise(shape, setup.facet, setup.coast, bend))
        right = (np.arange(shape[1]) + 0.5) * setup.facet
        kind = np.where(smooth_noise(shape, setup.facet, LAND_PATCH, patches) > 0, 1, 2)
        # the grid repeats: its last columns lie beside the left edge of the image, where there is water
        end = 0.5 * (width + shape[1] * setup.facet)
        np.copyto(self._fixed, kind.astype(np.uint16), where=(right > shore) & (right < end))

    def at(self, time: float) -> Labels:
        """Label (index in `materials`; 0 is water) of each facet, (row, column), `time` [s] after the earliest band."""
        labels = self._fixed.copy()
        for number, target in enumerate(self.setup.targets, start=len(BASE)):
            self._draw(labels, target, number, time)
        return labels

    def _draw(self, labels: Labels, target: FloatingTarget, number: int, time: float) -> None:
        """Draw hull (label `number`) and foam wake of a target in `labels`, at `time` [s] after the earliest band."""
        facet, azimuth, way = self.setup.facet, np.radians(target.heading), target.speed * time
        right, down = target.right + way * float(np.sin(azimuth)), target.down - way * float(np.cos(azimuth))
        reach = target.length + target.width + target.wake
        rows, columns = (
            slice(max(int((middle - reach) / facet), 0), max(min(int((middle + reach) / facet) + 1, count), 0))
            for middle, count in zip((down, right), labels.shape, strict=True)
        )
        part = labels[rows, columns]
        north = down - (np.arange(rows.start, rows.stop)[:, None] + 0.5) * facet
        east = (np.arange(columns.start, columns.stop)[None, :] + 0.5) * facet - right
        along = east * np.sin(azimuth) + north * np.cos(azimuth)  # distance ahead of the centre of the target
        across = east * np.cos(azimuth) - north * np.sin(azimuth)  # distance from its long axis, to starboard
        half = 0.5 * target.width
        if target.wake > 0:
            behind = (-0.5 * target.length - along) / target.wake
            speckle = np.random.default_rng(self._speckle).random((64, 64))
            tiled = speckle[np.arange(rows.start, rows.stop)[:, None] % 64, np.arange(columns.start, columns.stop) % 64]
            wide = half * (0.7 + 0.9 * np.sqrt(np.maximum(behind, 0.0)))
            foam = (behind > 0) & (np.abs(across) < wide) & (tiled > 0.4 + 0.6 * behind)
            part[foam] = 3
        taper = np.clip((0.5 * target.length - along) / (0.35 * target.length), 0.0, 1.0)  # the bow is narrower
        part[(np.abs(along) <= 0.5 * target.length) & (np.abs(across) <= half * taper)] = number

    def kinds(self, labels: Labels) -> Labels:
        """Convert labels (indices in `materials`) to values of the cover raster: OPEN_WATER, LAND, FOAM, TARGET."""
        table = np.full(len(self.materials), TARGET, np.uint8)
        table[:4] = OPEN_WATER, LAND, LAND, FOAM
        return table[labels]


def whitecaps(wind: float) -> float:
    """Share of the open sea that whitecaps cover [1]: ``2.95e-6 U**3.52`` for a wind speed U at 10 m [m/s], at most 1.

    References
    ----------
    Monahan and O'Muircheartaigh (1980), doi:10.1175/1520-0485(1980)010<2094:OPLDOO>2.0.CO;2.

    Examples
    --------
    >>> round(whitecaps(10.0), 4)
    0.0098
    """
    return min(2.95e-6 * wind**3.52, 1.0)
