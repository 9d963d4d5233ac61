"""deglint and other programs on the same simulated scenes: `python -m benchmarks field --directory FOLDER [--docs]`.

FOLDER holds copies of the other programs (see `field_peers`). A missing program is reported as not at hand. All
programs but deglint get the pixels of deep water from the truth, which is more than a user knows.
"""

from __future__ import annotations

import contextlib
import io
import logging
import re
import tempfile
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from deglint import Recipe, open_scene
from deglint.errors import DeglintError

from .field_peers import PEERS, Remove, Told
from .files import DATA, plane, values
from .implants import Sea, contrast, implant, scale, shared, survive, write
from .rates import laid_out
from .scenes import Known, deglinted, scenes
from .timing import ROOT, fill, in_turns, machine, table

Array = npt.NDArray[np.floating[Any]]
Entry = Callable[[Path, Told], Array]

NIR_WAVELENGTH = 833.0
"""The other programs get the band nearest to this wavelength as their NIR band [nm]."""
ALIKE = 0.1
"""Water is deep if each visible band of the truth differs from the water level by less than this share of it."""
LEAST_DEEP = 1000
"""Fewest pixels of deep water; in a scene with fewer of them, all pixels that count are the sample."""
GROUPS = {
    "0.1-0.5 m": r"wind|p0|discs|w3_|f30",
    "1-3 m": r"p[123]",
    "over a bottom": r"shallow",
    "resampled": r"resampled",
    "other sensors": r"sentinel2|planetscope|micasense|aerial",
    "hard cases": r"coast|foam|border|stripes|into",
    "own seeds": r"own",
}
"""Groups, and the starts of their scenes' names; hard: coast, foam, zeros, stripes, a view into the glint."""
TARGETS = ("wind05_delay60", "wind09_delay60")
"""Scenes into which white targets of 2, 3 and 5 pixels are put."""


def told_of(known: Known) -> Told:
    """Input of the other programs for a scene."""
    scene = open_scene(known.path)
    image = scene.read().astype(np.float64)
    waves = tuple(b.wavelength or 0.0 for b in scene.bands)
    full = np.array([b.saturation or image[i].max() for i, b in enumerate(scene.bands)])[:, None, None]
    level = known.level[:, None, None]
    near = np.abs(known.truth / level - 1)[list(known.visible)] < ALIKE
    deep = known.counts & near.all(axis=0)
    deep = deep if deep.sum() >= LEAST_DEEP else known.counts
    return Told(image, full, int(np.argmin(np.abs(np.array(waves) - NIR_WAVELENGTH))), known.visible, waves, deep)


def other(remove: Remove) -> Entry:
    """A function that runs another program, with the same parameters as for deglint and without its messages."""

    def run(_path: Path, told: Told) -> Array:
        with warnings.catch_warnings(), np.errstate(all="ignore"), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            return remove(told)

    return run


def programs(folder: Path | None) -> tuple[dict[str, Entry], dict[str, str]]:
    """Programs that can run, by name, and for the others, by name, the reason why they cannot."""
    ready: dict[str, Entry] = {
        "raw": lambda _path, told: told.image,
        "deglint remove": lambda path, _told: deglinted(path)[0],
        "deglint, Hedley": lambda path, _told: deglinted(path, Recipe(method="hedley", compensate="off"))[0],
    }
    missing = {}
    for peer in PEERS:
        try:
            if folder is None:
                raise ModuleNotFoundError("no --directory")
            ready[peer.name] = other(peer.load(folder, peer.function))
        except (ImportError, AttributeError) as error:
            missing[peer.name] = f"{error}"
    return ready, missing


def objects(path: Path) -> npt.NDArray[np.bool_]:
    """Mask of the objects under water, from a file beside the scene `path`."""
    mask = path.with_name(f"{path.stem}_mask.tif")
    return plane(mask if mask.exists() else path.with_name(f"{path.stem}_objects.tif")) > 0


def contrasts(image: Array, known: Known, there: npt.NDArray[np.bool_]) -> list[float]:
    """Share of its contrast that each object of mask `there` keeps, if it has 8 pixels and shows in the truth."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(there.astype(np.uint8), connectivity=8)
    square = np.ones((5, 5), np.uint8)
    far, found = cv2.dilate(there.astype(np.uint8), square) == 0, []
    for i in range(1, count):
        left, top, wide, high, _area = stats[i]
        box = (slice(max(0, top - 10), top + high + 10), slice(max(0, left - 10), left + wide + 10))
        core = cv2.erode((labels == i).astype(np.uint8), square)[box] > 0
        if min(wide, high) < 8 or core.sum() < 4 or far[box].sum() < 30:
            continue
        parts = [((a[b][box][core].mean() - np.nanmedian(a[b][box][far[box]])) / known.level[b])
                 for a in (known.truth, image) for b in known.visible]  # fmt: skip
        true, seen = np.array(parts).reshape(2, -1)
        if np.sqrt(np.mean(true**2)) >= 0.05:  # of the water; fainter ones do not show
            found.append(float(seen @ true / (true @ true)))
    return found


@dataclass
class PixelCounts:
    """Results of a program on all scenes."""

    errors: dict[str, float] = field(default_factory=dict)  # by scene [%]
    shares: list[float] = field(default_factory=list)  # of its contrast that each object keeps
    targets: list[float] = field(default_factory=list)  # share of its contrast that each white target keeps
    lost: list[float] = field(default_factory=list)  # share of pixels that have no value afterwards, of each scene


def measured(ready: Mapping[str, Entry], quick: bool) -> dict[str, PixelCounts]:
    """Run every program on every scene. Return the results by the program's name."""
    out = {name: PixelCounts() for name in ready}
    for group, known in scenes(quick):
        told, there = told_of(known), objects(known.path)
        stem = known.path.stem if group.endswith("/") else f"own_{known.path.stem}"
        for name, run in ready.items():
            try:
                image = run(known.path, told)
            except DeglintError:
                image = told.image
            out[name].errors[stem] = known.error(image)
            out[name].lost.append(float(np.isnan(image[list(known.visible)]).any(axis=0)[known.counts].mean()))
            out[name].shares += contrasts(image, known, there)
        print(stem, {n: round(t.errors[stem], 1) for n, t in out.items()}, flush=True)
    for name in TARGETS[: 1 if quick else None]:
        put_targets(shared(name), ready, out)
    return out


def put_targets(sea: Sea, ready: Mapping[str, Entry], out: Mapping[str, PixelCounts]) -> None:
    """Put white targets of 2, 3 and 5 pixels into a scene, run every program, and add the contrast left to `out`."""
    there, targets = implant(sea, [("white 30 %", size) for size in (2, 3, 5)], 0)
    told, units = told_of(Known.of(sea.path)), scale(sea.sensor)
    told = replace(told, image=there.image * units)
    with tempfile.TemporaryDirectory() as place:
        write(there, Path(place) / "in.tif")
        for name, run in ready.items():
            image = run(Path(place) / "in.tif", told) / units
            out[name].targets += contrast(image, sea.truth, there.truth, targets, sea.sensor).tolist()


def large(place: Path, side: int) -> tuple[Path, Told]:
    """A scene repeated to `side` x `side` pixels: its file in folder `place`, and the input of other programs."""
    source = DATA / "simulated" / "wind09_delay60.tif"
    path, told = laid_out(source, place / "large.tif", side, "uint16"), told_of(Known.of(source))
    times = -(-side // len(told.deep))
    return path, replace(told, image=values(path), deep=np.tile(told.deep, (times, times))[:side, :side])


def times(ready: Mapping[str, Entry], quick: bool, side: int) -> dict[str, float]:
    """Processor time of each program [s], from image in memory (deglint: from file) to corrected image."""
    with tempfile.TemporaryDirectory() as place:
        path, told = large(Path(place), side)
        jobs = {name: (lambda run=run: run(path, told)) for name, run in ready.items() if name != "raw"}
        found = in_turns(jobs, 1 if quick else 3, time.process_time)
    return {name: float(np.median(seconds)) for name, seconds in found.items()}


def mean(values: list[float]) -> str:
    """Geometric mean as text, or "-" without values."""
    return f"{np.exp(np.mean(np.log(values))):.1f}" if values else "-"


def kept(shares: list[float]) -> str:
    """Share of objects or targets that keep 80 to 125 % of their contrast, as text."""
    return f"{survive(np.array(shares)):.2f}" if shares else "-"


def errors(found: Mapping[str, PixelCounts]) -> str:
    """Table of the mean error of each program in each group of scenes."""
    rows = []
    for name, program in found.items():
        by = [mean([e for s, e in program.errors.items() if re.match(pattern, s)]) for pattern in GROUPS.values()]
        rows.append([name, mean(list(program.errors.values())), *by])
    counts = [sum(bool(re.match(p, s)) for s in found["raw"].errors) for p in GROUPS.values()]
    return table(("", "all", *(f"{name} ({n})" for name, n in zip(GROUPS, counts, strict=True))), rows)


def harm(found: Mapping[str, PixelCounts], seconds: Mapping[str, float]) -> str:
    """Table of programs: on how many scenes each is best or worse than raw, what it keeps and loses, its time."""
    rows, first = [], seconds["deglint remove"]
    for name, t in found.items():
        worse = sum(e > 1.02 * found["raw"].errors[s] for s, e in t.errors.items())
        best = sum(e <= min(o.errors[s] for o in found.values()) for s, e in t.errors.items())
        time_of = f"{seconds[name]:.2f} ({seconds[name] / first:.3f})" if name in seconds else "-"
        lost = f"{100 * np.mean(t.lost):.1f}"
        rows.append([name, str(best), str(worse), kept(t.shares), kept(t.targets), lost, time_of])
    return table(("", "best on", "worse than raw on", "objects kept", "white targets kept", "pixels lost [%]",
                  "time [s] (of deglint's)"), rows)  # fmt: skip


def better(found: Mapping[str, PixelCounts]) -> str:
    """Table of scenes on which another program, or the raw image, has a smaller error than the default of deglint."""
    ours, rows = found["deglint remove"], []
    for stem, error in ours.errors.items():
        name = min((n for n in found if not n.startswith("deglint")), key=lambda n: found[n].errors[stem])
        if found[name].errors[stem] < error:
            rows.append([stem, f"{error:.1f}", f"{found[name].errors[stem]:.1f}", name])
    return table(("scene", "deglint remove [%]", "best other [%]", "which"), rows) if rows else "None."


def parts(
    found: Mapping[str, PixelCounts], seconds: Mapping[str, float], missing: Mapping[str, str], side: int
) -> list[str]:
    """Texts of the measured parts of docs/field.md: the machine, and the results of `errors`, `harm` and `better`."""
    ratios = [seconds[n] / seconds["deglint remove"] for n in seconds if not n.startswith("deglint")] or [np.nan]
    absent = [f"Not at hand: {'; '.join(f'{name} ({why})' for name, why in missing.items())}."] if missing else []
    cost = (f"Times are those of 8 bands of {side} x {side} pixels. The other programs take {min(ratios):.3f} to "
            f"{max(ratios):.3f} of the time of deglint.")  # fmt: skip
    return ["\n\n".join([machine(), *absent]), errors(found), f"{harm(found, seconds)}\n\n{cost}", better(found)]


def main(quick: bool, directory: Path | None, docs: bool) -> None:
    """Measure and print; with `docs`, also write into docs/field.md. `directory` holds the other programs."""
    logging.getLogger("deglint").setLevel(logging.ERROR)
    if not (DATA / "simulated").exists():
        print("Skipped: the simulated scenes do not lie beside the project.")
        return
    ready, missing = programs(directory)
    for name, why in missing.items():
        print(f"{name}: not at hand ({why})")
    side = 512 if quick else 2048
    made = parts(measured(ready, quick), times(ready, quick, side), missing, side)
    for title, text in zip(("Field", "Error [%]", "Kept, and cost", "Another is better on"), made, strict=True):
        print(f"\n## {title}\n\n{text}")
    if docs:
        fill(ROOT / "docs" / "field.md", made)
