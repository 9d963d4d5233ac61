"""The machine, the versions and the command of a benchmark."""

import os
import platform
from contextlib import suppress
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

PACKAGES = ("deglint", "numpy", "scipy", "numba", "rasterio", "opencv-contrib-python-headless", "scikit-learn",
            "spectral")  # fmt: skip


def provenance(command: str, *, quick: bool, seeds: int, seconds: float, load: float | None) -> dict[str, Any]:
    """Versions, machine and options of a run; `seconds` is its duration [s], `load` the load average at its start."""
    now = machine()
    busy = f"load {load:g} on {now['cores']} cores" if load is not None and load > 0.5 * now["cores"] else ""
    return {
        "command": command, "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"), "quick": quick, "seeds": seeds,
        "seconds": round(seconds, 1), "machine": now, "busy": busy, "versions": versions(),
    }  # fmt: skip


def machine() -> dict[str, Any]:
    """Name of the processor, number of cores that this process may use, and operating system."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    system = f"{platform.system()} {platform.release()}"
    return {"processor": names[0] if names else platform.processor(), "cores": cores, "system": system}


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that are installed."""
    out = {"deglint": "", "python": platform.python_version()}
    for name in PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            out[name] = metadata.version(name)
    return out


def load_now() -> float | None:
    """Load average of the last minute; None if the system does not have one."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None
