"""Time, memory and bytes for small scenes up to scenes larger than memory, and the time for an archive.

Large scenes are mosaics (VRT) of one synthetic tile of 4096 x 4096 pixels and eight uint16 bands. The tile is larger
than GDAL's block cache: a block is read and decoded each time that its pixels are needed. Outputs are compressed (ZSTD
1). Measurements are kept in scale.json of the directory, so that a run that was stopped can be continued.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import rasterio

from .processes import in_turns
from .seas import write_sea
from .timing import ROOT, fill, machine, table

BAND_COUNT = 8
MOSAIC_TILE = 4096
MOSAIC_SIDES = (1024, 2048, 4096, 8192, 16384, 32768)
COMMANDS = {
    "remove": ["deglint", "remove", "-q", "--method", "joyce", "--compensate", "off"],
    "score": ["detect", "score", "-q"],
    "compensate and remove": ["deglint", "remove", "-q", "--method", "joyce", "--compensate", "thesis"],
}
SMALL_ROUNDS = 3
"""Runs of scenes up to the tile's size; the run of the least processor time counts."""
WORST = 1.3
"""Largest expected size of compressed output [byte per value]; so much must be free on the disk."""

TILE_SIDE, TILE_BANDS, PASSES = 10980, 4, 73
"""A Sentinel-2 tile: its side in pixels of 10 m, its bands of 10 m, and passes a year, one in five days."""
COAST_KM, COAST_WIDE_KM = 356_000, 20
"""Length of the world's coast in the CIA World Factbook, and the strip of sea along it."""
STORE = 1e9
"""Assumed data rate of a storage that all workers share [byte/s]."""


def mosaic(directory: Path, side: int) -> Path:
    """Write a VRT of side x side pixels that repeats `tile.tif`. Return its path. A missing tile is written, too."""
    tile, path = directory / "tile.tif", directory / f"{side}.vrt"
    if not tile.exists():
        write_sea(tile, MOSAIC_TILE)
    with rasterio.open(tile) as one:
        names, tags, crs, place = one.descriptions, [one.tags(b) for b in one.indexes], one.crs, one.transform.to_gdal()
    step = min(side, MOSAIC_TILE)
    lines = [f'<VRTDataset rasterXSize="{side}" rasterYSize="{side}"><SRS>{crs.to_string()}</SRS>']
    lines.append(f"<GeoTransform>{','.join(map(str, place))}</GeoTransform>")
    for band, (name, said) in enumerate(zip(names, tags, strict=True), start=1):
        lines.append(f'<VRTRasterBand dataType="UInt16" band="{band}"><Description>{name}</Description>'
                     f'<Scale>0.0001</Scale><Metadata><MDI key="wavelength">{said["wavelength"]}</MDI>'
                     '<MDI key="wavelength_units">nm</MDI></Metadata>')  # fmt: skip
        for row in range(0, side, step):
            for column in range(0, side, step):
                lines.append(  # noqa: PERF401
                    f'<SimpleSource><SourceFilename relativeToVRT="1">{tile.name}</SourceFilename>'
                    f'<SourceBand>{band}</SourceBand><SourceProperties RasterXSize="{MOSAIC_TILE}" '
                    f'RasterYSize="{MOSAIC_TILE}" DataType="UInt16" BlockXSize="512" BlockYSize="512"/>'
                    f'<SrcRect xOff="0" yOff="0" xSize="{step}" ySize="{step}"/>'
                    f'<DstRect xOff="{column}" yOff="{row}" xSize="{step}" ySize="{step}"/></SimpleSource>'
                )
        lines.append("</VRTRasterBand>")
    path.write_text("\n".join([*lines, "</VRTDataset>"]))
    return path


def measure(what: str, side: int, directory: Path) -> dict[str, Any]:
    """Measure a command on a mosaic and delete its output. Return the measurements, or why it was stopped."""
    scene, out = mosaic(directory, side), directory / "out.tif"
    free = shutil.disk_usage(directory).free
    if side**2 * BAND_COUNT * WORST > free - 2e9:
        return {"stopped": f"the disk has {free / 1e9:.0f} GB left"}
    call = [sys.executable, "-m", *COMMANDS[what], str(scene), str(out), "--overwrite",
            "--co", "COMPRESS=ZSTD", "--co", "ZSTD_LEVEL=1"]  # fmt: skip
    runs = in_turns({what: call}, SMALL_ROUNDS if side <= MOSAIC_TILE else 1)[what]
    size = out.stat().st_size if out.exists() else 0
    for left in directory.glob("*out.tif*"):
        left.unlink()
    if isinstance(runs, str):
        return {"stopped": runs}
    return asdict(min(runs, key=lambda r: r.cpu)) | {"size": size}


def collect(directory: Path, sides: tuple[int, ...]) -> dict[str, Any]:
    """Measure each command on each side, unless scale.json has it. Return all measurements."""
    kept = directory / "scale.json"
    found: dict[str, Any] = json.loads(kept.read_text()) if kept.exists() else {"machine": machine(), "runs": {}}
    for side in sides:
        for what in COMMANDS:
            if f"{what} {side}" not in found["runs"]:
                found["runs"][f"{what} {side}"] = measure(what, side, directory)
                kept.write_text(json.dumps(found, indent=1))
                print(f"{what}, {side}: {found['runs'][f'{what} {side}']}", file=sys.stderr, flush=True)
    return found


def line_of(found: dict[str, Any], what: str) -> dict[str, float]:
    """Processor time = start + slope x million values, from the smallest and the largest scene; bytes per value."""
    runs = {s: found["runs"].get(f"{what} {s}", {}) for s in MOSAIC_SIDES}
    runs = {s: r for s, r in runs.items() if "cpu" in r}
    low, high = runs[min(runs)], runs[max(runs)]
    values = [BAND_COUNT * s**2 / 1e6 for s in (min(runs), max(runs))]
    slope = (high["cpu"] - low["cpu"]) / (values[1] - values[0])
    return {
        "side": max(runs), "slope": slope, "start": max(low["cpu"] - slope * values[0], 0.0),
        "read": high["read"] / values[1] / 1e6, "written": high["size"] / values[1] / 1e6, "peak": high["peak"],
    }  # fmt: skip


def tables(found: dict[str, Any]) -> list[str]:
    """The machine, and tables of the measurements, of the models of `line_of`, and of `archive`, as markdown."""
    rows = []
    for what in COMMANDS:
        for side in MOSAIC_SIDES:
            run = found["runs"].get(f"{what} {side}")
            values = BAND_COUNT * side**2 / 1e6
            if run and "cpu" in run:
                rows.append([what, str(side), f"{values:.0f}", f"{run['cpu']:.2f}", f"{1e3 * run['cpu'] / values:.1f}",
                             f"{run['wall']:.1f}", f"{run['peak']:.0f}", f"{run['read'] / values / 1e6:.2f}",
                             f"{run['size'] / values / 1e6:.2f}"])  # fmt: skip
            elif run:
                rows.append([what, str(side), f"{values:.0f}", run["stopped"], "", "", "", "", ""])
    head = ("", "side [pixel]", "Mpx-band", "CPU [s]", "CPU [ms/Mpx-band]", "wall [s]", "peak [MB]",
            "read [byte/value]", "output [byte/value]")  # fmt: skip
    lines = {what: line_of(found, what) for what in COMMANDS}
    model = [[what, str(m["side"]), f"{m['start']:.2f}", f"{1e3 * m['slope']:.1f}", f"{m['read']:.2f}",
              f"{m['written']:.2f}"] for what, m in lines.items()]  # fmt: skip
    model_head = ("", "up to side", "start [s]", "ms/Mpx-band", "read [byte/value]", "written [byte/value]")
    return [found["machine"], table(head, rows), table(model_head, model), archive(lines)]


def archive(lines: dict[str, dict[str, float]]) -> str:
    """Table of times for a tile's year and the world's coast, by number of workers; *: storage is the limit."""
    strip = COAST_KM * COAST_WIDE_KM * 1e4 * TILE_BANDS / 1e6
    jobs = {
        f"a Sentinel-2 tile, a year ({PASSES} scenes)": (PASSES, PASSES * TILE_SIDE**2 * TILE_BANDS / 1e6),
        "the world's coast, once": (strip / (TILE_SIDE**2 * TILE_BANDS / 1e6), strip),
    }
    rows = []
    for name, (scenes, values) in jobs.items():
        for what, m in lines.items():
            cpu, moved = scenes * m["start"] + values * m["slope"], values * 1e6 * (m["read"] + m["written"])
            full = STORE / (moved / cpu)
            cells = [_time(max(cpu / n, moved / STORE)) + (" *" if n > full else "") for n in (1, 16, 256)]
            rows.append([name, what, f"{values:.3g}", _time(cpu), f"{moved / 1e9:.3g}", *cells, f"{full:.0f}"])
    return table(("", "", "Mpx-band", "CPU", "GB moved", "1 worker", "16", "256", "storage full at [workers]"), rows)


def _time(seconds: float) -> str:
    for unit, size in (("d", 86400), ("h", 3600), ("min", 60)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


def draw(found: dict[str, Any], path: Path) -> None:
    """Draw processor time per value, and peak memory, over the side of the scene, into a file."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, (cost, memory) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    for what, colour in zip(COMMANDS, ("#0b6e99", "#c8553d", "#5b8c5a"), strict=True):
        points = [(s, found["runs"].get(f"{what} {s}", {})) for s in MOSAIC_SIDES]
        points = [(s, r) for s, r in points if "cpu" in r]
        sides = [s for s, _ in points]
        cost.plot(sides, [1e9 * r["cpu"] / (BAND_COUNT * s**2) for s, r in points], "o-", color=colour, label=what)
        memory.plot(sides, [r["peak"] for _, r in points], "o-", color=colour, label=what)
    cost.set(ylabel="processor time [ns / value]", ylim=(0, None))
    memory.axhline(1000, color="0.6", linestyle=":")
    memory.set(ylabel="peak memory [MB]", ylim=(0, 1100))
    for axes in (cost, memory):
        axes.set_xscale("log", base=2)
        axes.set(xlabel="side of the scene [pixel], 8 bands", xticks=MOSAIC_SIDES, xticklabels=map(str, MOSAIC_SIDES))
        axes.grid(alpha=0.3)
    cost.legend(frameon=False)
    figure.savefig(path, dpi=110)


def main(quick: bool, directory: Path | None, docs: bool) -> None:
    """Measure and print; with `docs`, also write the picture and the tables into docs/."""
    with tempfile.TemporaryDirectory(dir=directory) as scratch:
        place = directory or Path(scratch)
        found = collect(place, MOSAIC_SIDES[:3] if quick else MOSAIC_SIDES)
        made = tables(found)
        print("\n\n".join(["## Scale", *made]))
        if docs:
            draw(found, ROOT / "docs" / "scale.png")
            fill(ROOT / "docs" / "scale-model.md", made)
