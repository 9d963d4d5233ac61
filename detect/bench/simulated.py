"""Scenes whose truth is known, for the experiments: simulated, written for `deglint`, cleaned by a recipe.

On the left deep water, the sample of every fit; on the right squares of 4 m at a depth of 5 m, one column a
reflectance. The sky is cardioidal: under a brighter sky around the sun the truth itself holds mirrored sky, which no
method can tell from glint, and taking it away counts as error (docs/compensation.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from deglint import Recipe, Scene, correct, fit_scene, open_scene
from deglint.compensate.evidence import Protection
from deglint.errors import DeglintError
from deglint.physics.presets import preset
from deglint.physics.sensor import Sensor
from deglint.simulate import Setup, SimulatedScene, SubmergedObject, simulate_together, square

from .measure import Float64, Mask

SIDE = 256
"""Rows and columns [pixel of 25 cm]."""
REFLECTANCES = (0.02, 0.05, 0.10, 0.20)
PIXELS, DEPTH = 16, 5.0
"""Side of an object [pixel], and how deep it lies [m]."""
SPREAD = 4
"""Pixels around objects that are neither object nor background: the optics put light of the object there."""
SKY = "cardioidal"
SEED = 100
"""Seed of the first sea."""

T = TypeVar("T")
R = TypeVar("R")


def objects(side: int, gsd: float) -> tuple[SubmergedObject, ...]:
    """Columns of objects in the right half, one a reflectance."""
    across, down = side / 2 / len(REFLECTANCES), min(64, side)
    return tuple(
        square((side / 2 + (j + 0.5) * across) * gsd, (i + 0.5) * down * gsd, min(PIXELS, across / 2) * gsd,
               reflectance=reflectance, depth=DEPTH)
        for i in range(side // down) for j, reflectance in enumerate(REFLECTANCES)
    )  # fmt: skip


def ideal() -> Sensor:
    """The sensor before any effect: sharp, without noise that shows, all bands at one instant."""
    return replace(preset("thesis").delayed(0.0), name="ideal", f_number=2.0, smear=0.0, well=1e9, read_noise=0.0,
                   bits=16)  # fmt: skip


def setups(
    sensors: Iterable[Sensor], wind: float, seed: int, look: tuple[float, float] = (0.0, 0.0), side: int = SIDE
) -> list[Setup]:
    """One sea seen by several sensors; the look is a view zenith angle and an azimuth from that of the sun [deg]."""
    return [
        Setup(sensor=s, size=(side, side), wind=wind, sky=SKY, objects=objects(side, s.gsd), seed=SEED + seed,
              view_zenith=look[0], view_azimuth=(Setup.sun_azimuth + look[1]) % 360)
        for s in sensors
    ]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Seen:
    """A simulated scene as a file, and what is known of it; arrays (band, row, column) [W m-2 sr-1 nm-1].

    Attributes
    ----------
    made : SimulatedScene
    file : Path
    """

    made: SimulatedScene
    file: Path

    @cached_property
    def scale(self) -> Float64:
        """Radiance of a digital number, to multiply a scene with."""
        sensor = self.made.setup.sensor
        return np.array([sensor.scale(b) for b in sensor.bands])[:, None, None]

    @cached_property
    def raw(self) -> Float64:
        """What the sensor gives."""
        return np.asarray(self.made.image * self.scale)

    @property
    def glinting(self) -> Float64:
        """What reaches the detector: with glint, without noise and saturation."""
        return self.truth + self.made.glint

    @cached_property
    def truth(self) -> Float64:
        """Without glint and noise."""
        return self.made.truth.astype(np.float64)

    @cached_property
    def noisy(self) -> Float64:
        """The truth with the scene's noise: what removing all glint and nothing else would give."""
        return np.asarray(self.made.truth_image * self.scale)

    @cached_property
    def scene(self) -> Scene:
        """As deglint opens it."""
        return open_scene(str(self.file))

    @property
    def deep(self) -> slice:
        """Columns of the sample."""
        return slice(self.made.setup.size[1] // 2)

    @property
    def sample(self) -> Mask:
        """The sample as a mask."""
        mask = np.zeros(self.made.setup.size, np.bool_)
        mask[:, self.deep] = True
        return mask

    @cached_property
    def kinds(self) -> npt.NDArray[np.int64]:
        """0 background, an object's reflectance by number from 1, -1 around objects, where the optics spread them."""
        import cv2

        labels = self.made.objects.astype(np.int64)
        near = cv2.dilate((labels > 0).astype(np.uint8), np.ones((2 * SPREAD + 1, 2 * SPREAD + 1), np.uint8)) > 0
        return np.where(labels > 0, (labels - 1) % len(REFLECTANCES) + 1, np.where(near, -1, 0))

    def cleaned(self, method: str, compensate: str, *, protect: bool = True) -> Float64:
        """Without glint.

        Parameters
        ----------
        method : str
            As in `Recipe`, or "none": no removal, only the stages of the compensation that stand before it.
        compensate : str
            As in `Recipe`.
        protect : bool
            Keep small things that stand out unlike glint, as `deglint remove` does.

        Raises
        ------
        DeglintError
            The scene cannot be fitted.
        """
        if method == "none" and compensate == "off":
            return self.raw
        rows, columns = self.made.setup.size
        recipe = Recipe(method="joyce" if method == "none" else method, compensate=compensate,
                        sample=f"0,0,{columns // 2},{rows}", mask="none")  # fmt: skip
        fitted = fit_scene(self.scene, recipe, threads=1)
        if method == "none":
            fitted = replace(fitted, model=replace(fitted.model, fits=()), chain=replace(fitted.chain, after=()))
        if not protect:
            nothing = Protection(reason="left out, to see what it does")
            fitted = replace(fitted, chain=replace(fitted.chain, protection=nothing))
        return correct(self.scene, fitted).astype(np.float64)


def see(setups: Sequence[Setup], directory: Path, name: str) -> list[Seen]:
    """Simulate one sea for several sensors, and write what they see as NAME-1.tif, NAME-2.tif ..."""
    from deglint.raster.simulated import write_scene

    out = []
    for number, made in enumerate(simulate_together(setups), start=1):
        files = write_scene(made, directory / f"{name}-{number}", overwrite=True, truth=False)
        out.append(Seen(made, files[0]))
    return out


def forget(scenes: Iterable[Seen]) -> None:
    """Remove the files of scenes."""
    for seen in scenes:
        seen.file.unlink(missing_ok=True)
        seen.file.with_suffix(".json").unlink(missing_ok=True)


def each(work: Callable[[T], R], tasks: Sequence[T], threads: int) -> list[R]:
    """Results of tasks in their order, on threads."""
    with ThreadPoolExecutor(max(1, threads)) as pool:
        return list(pool.map(work, tasks))


def cleaned_or_none(seen: Seen, method: str, compensate: str, *, protect: bool = True) -> Float64 | None:
    """The scene without glint, or None where it cannot be fitted."""
    try:
        return seen.cleaned(method, compensate, protect=protect)
    except DeglintError:
        return None
