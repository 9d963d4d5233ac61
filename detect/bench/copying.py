"""A scene that needs nothing, against a plain block copy of the same file: bits and time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from deglint import Recipe, remove_glint

from ..report.svg import Axis, Series, Size, plot
from .section import Effort, Figure, Number, Section, Table, timed
from .tradeoff_measure import spent

BANDS = (("blue", 480), ("green", 550), ("red", 660), ("nir", 842))
LEVELS = (900.0, 700.0, 400.0, 100.0)
NOISE = 4.0
SIDES, QUICK_SIDES = (1024, 2048, 4096), (1024,)
KINDS = {
    "cog": "tiled, header first, deflate",
    "plain": "tiled, header first, uncompressed",
    "strips": "strips, uncompressed",
}
TILE = 256


@dataclass
class Copies:
    """Processor times [s] by (side, kind): rounds of `deglint remove` and of the block copy; and whether bits agree."""

    own: dict[tuple[int, str], list[float]] = field(default_factory=dict)
    block: dict[tuple[int, str], list[float]] = field(default_factory=dict)
    same: dict[tuple[int, str], str] = field(default_factory=dict)

    @property
    def sides(self) -> list[int]:
        """Sides that were measured [pixel]."""
        return sorted({side for side, _ in self.own})

    def ratio(self, side: int, kind: str) -> float:
        """Of `deglint remove` to the block copy, median of rounds."""
        return float(np.median(np.divide(self.own[side, kind], self.block[side, kind])))


def measure(effort: Effort) -> Copies:
    """Calm water of several sizes, in several kinds of files; in turns, after a first round that does not count."""
    found = Copies()
    for side in QUICK_SIDES if effort.quick else SIDES:
        for kind in KINDS:
            source, out, plain = (effort.directory / f"copying-{n}.tif" for n in ("in", "out", "plain"))
            write_calm(source, side, kind)
            jobs: dict[str, Callable[[], Any]] = {
                "own": lambda s=source, o=out: remove_glint(s, o, Recipe(), threads=1, overwrite=True),  # type: ignore[misc]
                "block": lambda s=source, p=plain: block_copy(s, p),  # type: ignore[misc]
            }
            rounds = 2 if effort.quick else 4
            for number in range(rounds):
                for name, job in jobs.items():
                    seconds, _ = spent(job)
                    if number:
                        getattr(found, name).setdefault((side, kind), []).append(seconds)
            found.same[side, kind] = compared(source, out)
            for path in (source, out, plain, Path(f"{out}.json")):
                path.unlink(missing_ok=True)
    return found


def write_calm(path: Path, side: int, kind: str) -> None:
    """Even water with noise and no glint, made tile by tile."""
    import rasterio

    layout: dict[str, Any] = {"tiled": True, "blockxsize": TILE, "blockysize": TILE, "interleave": "pixel"}
    if kind == "strips":
        layout = {"interleave": "pixel"}
    if kind == "cog":
        layout |= {"compress": "deflate", "predictor": 2}
    profile = {"driver": "GTiff", "dtype": "uint16", "count": len(BANDS), "height": side, "width": side}
    with rasterio.open(path, "w", **profile, **layout, crs="EPSG:32610",
                       transform=rasterio.Affine(2, 0, 6e5, 0, -2, 4e6)) as out:  # fmt: skip
        for i, (name, wavelength) in enumerate(BANDS, start=1):  # before the first pixel: the header stays in front
            out.set_band_description(i, name)
            out.update_tags(i, wavelength=str(wavelength))
        for top in range(0, side, TILE):
            rng = np.random.default_rng([7, side, top])
            rows = np.array(LEVELS)[:, None, None] + rng.normal(0, NOISE, (len(BANDS), TILE, side))
            out.write(np.rint(rows).astype(np.uint16), window=((top, top + TILE), (0, side)))


def block_copy(source: Path, target: Path) -> None:
    """What every tool that reads and writes a raster must at least do: all bands of each block, read and written."""
    import rasterio

    with rasterio.open(source) as scene:
        profile = dict(scene.profile)
        if predictor := scene.tags(ns="IMAGE_STRUCTURE").get("PREDICTOR"):
            profile["predictor"] = predictor
        with rasterio.open(target, "w", **profile) as out:
            for _, window in scene.block_windows(1):
                out.write(scene.read(window=window), window=window)


def compared(a: Path, b: Path) -> str:
    """How alike two rasters are: "bytes", "pixels" or "different"."""
    import rasterio

    if a.read_bytes() == b.read_bytes():
        return "bytes"
    with rasterio.open(a) as one, rasterio.open(b) as other:
        return "pixels" if np.array_equal(one.read(), other.read()) else "different"


def section(found: Copies) -> Section:
    """The chapter."""
    rows, out = [], {}
    for (side, kind), own in found.own.items():
        ratios = np.divide(own, found.block[side, kind])
        key = f"skipping/copy/{kind}/side{side}"
        out[f"{key}/ratio"] = timed(list(ratios))
        out[f"{key}/same"] = Number(float(found.same[side, kind] != "different"), better="higher")
        rows.append((KINDS[kind], side, float(np.median(found.block[side, kind])), float(np.median(own)),
                     out[f"{key}/ratio"], f"same {found.same[side, kind]}"))  # fmt: skip
    head = ("file", "side [px]", "block copy [s]", "deglint remove [s]", "ratio", "bits")
    note = f"{len(BANDS)} bands of uint16; processor time in one process, one thread, after a first run."
    table = Table.of("Calm water, against a plain block copy", head, rows, note)
    largest = max(found.sides)
    fixed = np.median([np.median(own) for (side, _k), own in found.own.items() if side == min(found.sides)])
    said = (
        "Where no band needs a correction the file itself is copied, byte for byte, if that is what would be written "
        "(one tiled GeoTIFF with its header first, no other type or option asked for), and else its pixels, block by "
        f"block, without looking at them. Finding that out looks at a part of the scene, which takes {fixed:.2g} s "
        f"whatever its size. At {largest} x {largest} pixels that and the copy take "
        f"{found.ratio(largest, 'cog'):.2f} times what a block copy of a compressed file takes, "
        f"{found.ratio(largest, 'plain'):.2f} times of an uncompressed one, and {found.ratio(largest, 'strips'):.2f} "
        "times where strips are made tiles."
    )
    figures = (_figure(found),) if len(found.sides) > 1 else ()
    return Section("skipping/copy", "A scene that needs nothing", (said,), (table,), figures, out)


def _figure(found: Copies) -> Figure:
    at = np.array(found.sides, np.float64)
    lines = []
    for kind in KINDS:
        y = np.array([found.ratio(side, kind) for side in found.sides])
        lines.append(Series(KINDS[kind], at, y, None, tuple(zip(at, y, strict=True))))
    most = max(float(line.y.max()) for line in lines)
    x = Axis("side of the scene [pixel]", at.min() / 1.2, at.max() * 1.2, log=True)
    y_axis = Axis("time, of a block copy", min(0.05, *(float(line.y.min()) / 2 for line in lines)), most * 2, log=True)
    drawn = plot(lines, x, y_axis, title="time of copying what needs nothing", legend=True, size=Size(720, 380),
                 chance=(np.array([x.low, x.high]), np.ones(2)))  # fmt: skip
    return Figure("Time against a block copy", drawn, "Dotted: as long as the block copy.")
