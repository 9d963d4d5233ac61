"""On what a benchmark was measured, with which versions, and the command that makes it again."""

from __future__ import annotations

import os
import platform
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from .collect import Collected
from .section import Effort

PACKAGES = (
    "numpy", "scipy", "numba", "rasterio", "opencv-contrib-python-headless", "scikit-image", "scikit-learn", "spectral",
    "sensingpy", "mpmath",
)  # fmt: skip
"""What the numbers depend on, or are compared with."""


def provenance(command: str, effort: Effort, found: Collected, load: float | None) -> dict[str, Any]:
    """Everything that another needs to make the numbers again, or to tell why they differ.

    Parameters
    ----------
    command : str
    effort : Effort
    found : Collected
    load : float or None
        Of the machine when the first experiment started.
    """
    return {
        "command": command,
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "seconds": round(sum(found.seconds.values()), 1),
        "quick": effort.quick,
        "seeds": effort.seeds,
        "threads": effort.threads,
        "machine": machine() | {"load at the start": load, "load at the end": load_now()},
        "versions": versions(),
        "experiments": {name: round(seconds, 1) for name, seconds in found.seconds.items()},
    }


def machine() -> dict[str, Any]:
    """Processor, cores that this process may use, memory, system."""
    return {"processor": processor(), "cores": cores(), "memory": memory(), "system": _system()}


def versions() -> dict[str, str]:
    """Versions of the project, Python and what the numbers depend on; what is not installed is left out."""
    out = {"deglint": _version("deglint"), "python": platform.python_version()}
    out |= {name: _version(name) for name in PACKAGES}
    return {name: version for name, version in out.items() if version}


def cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def load_now() -> float | None:
    """Processes that ran or waited for a core in the last minute, where the system tells."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None


def memory() -> str:
    """Main memory, as text."""
    try:
        pages, size = os.sysconf("SC_PHYS_PAGES"), os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return "not known"
    return f"{pages * size / 2**30:.0f} GiB"


def processor() -> str:
    """Name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _system() -> str:
    return f"{platform.system()} {platform.release()}"


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""
