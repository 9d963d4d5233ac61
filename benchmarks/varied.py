"""Is the default harmless? Its error on scenes with random parameters, beside those of raw, Hedley and Joyce.

Sensor, pixel size, wind, sun and delay of each scene are random; bottom, coast, boats, rocks, foam, misregistration,
striping, resampling and JPEG occur by chance. The number of a scene is its seed; no constant was set on these scenes.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from deglint import Recipe, open_scene
from deglint.errors import DeglintError, InputError
from deglint.physics.presets import preset
from deglint.raster.simulated import write_scene
from deglint.simulate import FloatingTarget, Setup, simulate, whitecaps
from deglint.simulate.artefacts import Artefacts
from deglint.simulate.cover import TARGET
from deglint.simulate.underwater import Bottom

from .files import values
from .scenes import SCENE_SIDE, Array, Known, deglinted, objects
from .timing import machine, say

COUNT, QUICK_COUNT = 40, 6
"""Number of scenes, and number with `--quick`."""
SENSORS = ("thesis", "thesis", "thesis-f30", "worldview3", "worldview3", "micasense", "sentinel2")
PIXEL_RANGES = {"thesis": (0.1, 0.5), "thesis-f30": (0.1, 0.5), "worldview3": (0.3, 2.0), "micasense": (0.04, 0.25)}
"""Range of the side of a pixel [m]. Other sensors have the side of their preset."""
COARSE_PIXEL = 2.0
"""Side of a pixel from which on facets do not resolve the waves of a wind of 2 m/s [m]."""
DELAYS = (None, 0.0, 0.02, 0.06)
"""Delays between neighbouring bands [s]; None: those of the sensor itself."""
MATERIALS = ("paint", "rock", "algae")
HARMED = 1.02
"""A scene is harmed if its error, over the least error of raw, Hedley and Joyce, is above this ratio."""


def drawn(number: int) -> Setup:
    """Random parameters of scene `number`."""
    rng = np.random.default_rng([21, number])
    name, delay = str(rng.choice(SENSORS)), DELAYS[rng.integers(len(DELAYS))]
    sensor = preset(name)
    if name in PIXEL_RANGES:
        sensor = replace(sensor, gsd=round(float(np.exp(rng.uniform(*np.log(PIXEL_RANGES[name])))), 3))
    sensor = sensor if delay is None else sensor.delayed(delay)
    gsd = sensor.gsd
    wind = float(rng.integers(2 if gsd < COARSE_PIXEL else 4, 13))
    side = SCENE_SIDE * gsd

    def some(share: float) -> bool:
        return bool(rng.random() < share)

    boats = tuple(
        FloatingTarget(
            right=float(rng.uniform(0.1, 0.6)) * side, down=float(rng.uniform(0.1, 0.9)) * side,
            length=float(rng.uniform(3, 12) * max(gsd, 1)), width=float(rng.uniform(2, 4) * max(gsd, 1)),
            speed=float(rng.choice([0.0, 3.0])), heading=float(rng.uniform(0, 360)),
            material=str(rng.choice(MATERIALS)),
        )
        for _ in range(int(rng.integers(1, 4)) if some(0.4) else 0)
    )  # fmt: skip
    bottom = Bottom(
        depth=(float(rng.uniform(8, 30)), float(rng.uniform(2, 6))), roughness=float(rng.uniform(0, 1)),
        share=float(rng.uniform(0, 0.6)), patch=float(rng.uniform(3, 20) * max(gsd, 0.5)),
    )  # fmt: skip
    moved = tuple((float(d), float(r)) for d, r in rng.uniform(-0.4, 0.4, (len(sensor.bands), 2)))
    artefacts = Artefacts(
        striping=0.01 if some(0.2) else 0.0,
        resampling=(None, "bilinear", "cubic", "lanczos")[rng.integers(4)] if some(0.3) else None,
        jpeg=int(rng.integers(75, 96)) if some(0.15) else None,
    )
    return Setup(
        sensor=sensor, size=(SCENE_SIDE, SCENE_SIDE), wind=wind, wind_from=float(rng.uniform(0, 360)), seed=number,
        sun_zenith=float(rng.uniform(15, 60)), patch=float(rng.choice([0.0, 0.02, 0.06])),
        objects=() if some(0.4) else objects("square", "disc", gsd=gsd), bottom=bottom if some(0.35) else None,
        coast=0.15 * side if some(0.25) else 0.0, foam=float(whitecaps(wind)) if some(0.25) else 0.0, targets=boats,
        misregistration=moved if some(0.25) else (), artefacts=artefacts,
    )  # fmt: skip


def described(setup: Setup) -> str:
    """Description of a scene in a few words."""
    sensor, a = setup.sensor, setup.artefacts
    parts = [f"{sensor.name} {sensor.gsd:.2g} m", f"{max(setup.times):.2g} s", f"wind {setup.wind:g}",
             f"sun {setup.sun_zenith:.0f}"]  # fmt: skip
    there = {
        "bottom": setup.bottom, "coast": setup.coast, "foam": setup.foam, "boats": setup.targets,
        "misregistered": setup.misregistration, "striped": a.striping, str(a.resampling): a.resampling, "JPEG": a.jpeg,
    }  # fmt: skip
    return ", ".join(parts + [name for name, value in there.items() if value])


def kept(known: Known, image: Array, afloat: npt.NDArray[np.bool_]) -> float:
    """Share of their contrast that floating targets, whose pixels are `afloat`, keep in an image; 1 is all of it."""
    water = known.level[:, None]
    true, left = ((a[:, afloat] - water)[list(known.visible)] for a in (known.truth, image))
    return float((left * true).sum() / (true * true).sum())


def row(number: int, folder: Path) -> tuple[float, list[str]] | None:
    """Error of the default over the least of raw, Hedley, Joyce; and the scene's row. None if a boat lies outside."""
    try:
        setup = drawn(number)
    except InputError:
        return None
    write_scene(simulate(setup), folder / "scene", overwrite=True)
    known = Known.of(folder / "scene.tif")
    raw = values(known.path)
    errors = {"raw": known.error(raw)}
    for method in ("hedley", "joyce"):
        try:
            errors[method] = known.error(deglinted(known.path, Recipe(method=method, compensate="off"))[0])
        except DeglintError:
            errors[method] = np.inf
    image, fitted = deglinted(known.path)
    error = known.error(image)
    ratio = error / min(errors.values())
    boats = "-"
    cover = folder / "scene_cover.tif"
    if setup.targets:
        afloat = (open_scene(cover).read() == TARGET).all(axis=0)
        boats = f"{kept(known, image, afloat):.2f}" if afloat.any() else "-"
    chosen = fitted.choice.best.name if fitted.choice else ""
    cover.unlink(missing_ok=True)
    cells = [f"{e:.1f}" for e in (*errors.values(), error)]
    return ratio, [str(number), described(setup), chosen, *cells, f"{ratio:.2f}", boats]


def main(quick: bool) -> None:
    """Print the errors of all scenes, and on how many the default does harm."""
    print("## Scenes drawn at random\n\n" + machine())
    with tempfile.TemporaryDirectory() as folder:
        found = [r for n in range(QUICK_COUNT if quick else COUNT) if (r := row(n, Path(folder)))]
    ratios = np.array([ratio for ratio, _ in found])
    head = ("", "scene", "recipe", "raw", "Hedley", "Joyce", "default", "ratio", "floating kept")
    note = (f"Error of the visible bands [% of the water]; ratio to the best of raw, Hedley and Joyce. Above "
            f"{HARMED} on {(ratios > HARMED).sum()} of {len(ratios)}, at worst {ratios.max():.2f}; geometric mean "
            f"{np.exp(np.log(ratios).mean()):.2f}.")  # fmt: skip
    say("Error", head, [cells for _, cells in found], note)
