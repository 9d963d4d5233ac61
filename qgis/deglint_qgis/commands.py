"""The algorithms as tables, their parameters as arguments of the commands, and how a command runs.

A command runs as a process of its own: QGIS and the package each bring a GDAL, and two of them in one process do not
agree. Nothing here imports QGIS.
"""

from __future__ import annotations

import os
import queue
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

METHODS = (
    "auto", "wiener", "hedley", "lyzenga", "joyce", "multiband", "hochberg", "goodman", "kutser", "nir-subtraction",
)  # fmt: skip
DETECTORS = ("auto", "sea", "lines", "rx", "local", "utd", "rx-utd", "subspace", "residual")
SENSORS = ("thesis", "thesis-f30", "worldview3", "micasense", "sentinel2")
FOREIGN = ("PYTHONHOME", "PYTHONPATH", "GDAL_DATA", "GDAL_DRIVER_PATH", "PROJ_LIB", "PROJ_DATA", "LD_LIBRARY_PATH")
"""Variables of QGIS's own environment that would mislead another Python."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of an algorithm.

    Attributes
    ----------
    name : str
        As QGIS calls it.
    flag : str
        Option of the command; empty for a positional argument.
    kind : {"raster", "file", "choice", "text", "number", "point", "raster out", "vector out", "file out"}
    title : str
    default : object
    choices : tuple of str
    filter : str
        Of a file to write.
    needed : bool
    """

    name: str
    flag: str
    kind: str
    title: str
    default: Any = None
    choices: tuple[str, ...] = ()
    filter: str = ""
    needed: bool = False


@dataclass(frozen=True)
class Algorithm:
    """An algorithm: the command that it runs, what it says of itself, its parameters."""

    program: str
    command: str
    title: str
    help: str
    parameters: tuple[Parameter, ...]


SCENE = Parameter("INPUT", "", "raster", "Scene", needed=True)
NIR = Parameter("NIR", "--nir", "text", "NIR bands, by name or number; empty: deduced")
MASK = Parameter("MASK", "--mask", "file", "Area to work on: raster or GeoJSON; empty: found")
ALGORITHMS = {
    "remove": Algorithm("deglint", "remove", "Remove sun glint", "Removes sun glint from a multispectral image.", (
        SCENE,
        Parameter("METHOD", "--method", "choice", "Method", "auto", METHODS),
        Parameter("COMPENSATE", "--compensate", "text", "Compensation: auto, thesis, off or stages", "auto"),
        Parameter("SMALLEST", "--smallest-object", "text", "Width of the smallest target to keep, such as 4m"),
        NIR,
        Parameter("SAMPLE", "--sample", "file", "Deep water to fit to: GeoJSON; empty: found"),
        MASK,
        Parameter("SENSOR", "--sensor", "text", "Sensor, where the file does not say its wavelengths"),
        Parameter("FLAGS", "--flags", "raster out", "Flags"),
        Parameter("AMOUNT", "--amount", "raster out", "Removed glint"),
        Parameter("OUTPUT", "", "raster out", "Deglinted image", needed=True),
    )),
    "info": Algorithm("deglint", "info", "Describe a scene", "Bands, NIR, water and glint of a scene, as text.", (
        SCENE, NIR, Parameter("OUTPUT", ">", "file out", "Description", filter="Text (*.txt)", needed=True),
    )),
    "score": Algorithm("rxdetect", "score", "Find anomalies", "Scores every pixel and marks ships, boats, swimmers.", (
        SCENE,
        Parameter("METHOD", "--method", "choice", "Detector", "auto", DETECTORS),
        Parameter("FALSE_PER_KM2", "--false-per-km2", "number", "False objects wanted per square kilometre"),
        Parameter("PFA", "--pfa", "number", "Or false alarms wanted per pixel"),
        MASK,
        Parameter("OBJECTS", "--objects", "vector out", "Objects (needs one of the two rates)"),
        Parameter("OUTPUT", "", "raster out", "Scores", needed=True),
    )),
    "plan": Algorithm("deglint", "plan", "Plan a flight", "Where to look from so that glint does not spoil it.", (
        Parameter("PLACE", "", "point", "Place", needed=True),
        Parameter("TIME", "--time", "text", "Time in UTC, such as 2026-06-21T18:00Z; empty: now"),
        Parameter("WIND", "--wind", "text", "Wind in m/s @ where it blows from in degrees", "5@0"),
        Parameter("SENSOR", "--sensor", "choice", "Sensor", "thesis", SENSORS),
        Parameter("DEPTH", "--depth", "number", "Depth of the object [m]", 5.0),
        Parameter("OUTPUT", "-o", "file out", "Reticle", filter="Picture (*.png)", needed=True),
    )),
}  # fmt: skip
"""The algorithms by name. Outputs are replaced, since QGIS asks before it names one that exists."""


def arguments(name: str, values: Mapping[str, Any]) -> list[str]:
    """Arguments of an algorithm's command; values that are None or empty are left out.

    Parameters
    ----------
    name : str
        Key of `ALGORITHMS`.
    values : mapping
        By the parameters' names: texts and numbers; of a point (longitude, latitude).
    """
    algorithm, positional, options = ALGORITHMS[name], [], []
    for parameter in algorithm.parameters:
        value = values.get(parameter.name)
        if value is None or value == "" or parameter.flag == ">":
            continue
        if parameter.kind == "point":
            options += ["--lon", f"{value[0]:.6f}", "--lat", f"{value[1]:.6f}"]
        elif parameter.flag:
            options += [parameter.flag, str(value)]
        else:
            positional.append(str(value))
    if name != "info":
        options.append("--overwrite")
    return [algorithm.command, *options, *(["--", *positional] if positional else [])]


def executable(program: str) -> list[str]:
    """The command of a program: from DEGLINT_BIN, the PATH, or beside QGIS's own Python.

    Raises
    ------
    FileNotFoundError
        There is none.
    """
    places = [os.environ.get("DEGLINT_BIN"), None, str(Path(sys.prefix) / "bin"), str(Path(sys.prefix) / "Scripts")]
    for place in places if places[0] else places[1:]:
        found = shutil.which(program, path=place)
        if found:
            return [found]
    raise FileNotFoundError(
        f"the command {program} is not found. Install it with: pip install deglint - then start QGIS where it is on "
        "the PATH, or name its folder in the environment variable DEGLINT_BIN."
    )


def run(
    command: list[str], say: Callable[[str], None], progress: Callable[[float], None], stopped: Callable[[], bool]
) -> tuple[int, str]:
    """Run a command; its log is said line by line.

    Returns
    -------
    int
        Exit code; 130 where it was stopped.
    str
        What it printed on stdout.
    """
    environment = {k: v for k, v in os.environ.items() if k not in FOREIGN}
    lines: queue.Queue[str | None] = queue.Queue()
    out: list[str] = []

    def listen(stream: Any) -> None:
        for line in stream:
            lines.put(line.rstrip())
        lines.put(None)

    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, **pipes, text=True, errors="replace", env=environment) as process:
        readers = [threading.Thread(target=listen, args=(process.stderr,)),
                   threading.Thread(target=lambda: out.extend(process.stdout or ()))]  # fmt: skip
        for reader in readers:
            reader.start()
        line: str | None = ""
        while line is not None:
            try:
                line = lines.get(timeout=0.2)
            except queue.Empty:
                if stopped():
                    process.terminate()
                continue
            if line:
                say(line)
                share = re.search(r"(\d+) %", line)
                if share:
                    progress(float(share[1]))
        for reader in readers:
            reader.join()
    return (130 if stopped() else process.returncode), "".join(out)
