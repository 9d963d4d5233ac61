"""With what a report was made: versions, machine, command, inputs with their checksums."""

from __future__ import annotations

import os
import platform
from datetime import UTC, datetime
from typing import Any

from deglint import __version__
from deglint.checksum import Checksum
from deglint.pipeline.sidecar import versions

from .evaluate import Request


def begin_inputs(request: Request) -> Checksum:
    """The checksums of what is judged, begun before it is read."""
    return Checksum([*request.scores, request.truth, *([request.mask] if request.mask else [])])


def provenance(request: Request, command: str, seconds: float, checksum: Checksum) -> dict[str, Any]:
    """Everything that another needs to make the report again; a ReadError where a file was changed while it was read.

    `seconds` is what judging took [s], `checksum` comes from `begin_inputs`.
    """
    import cv2
    import scipy

    return {
        "command": command,
        "rxdetect": __version__,
        "versions": versions() | {"scipy": scipy.__version__, "opencv": cv2.__version__},
        "machine": {"system": platform.platform(), "processor": platform.machine(), "processors": os.cpu_count()},
        "seed": request.seed,
        "seconds": round(seconds, 2),
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "inputs": [{k: f[k] for k in ("path", "bytes", "crc32")} for f in checksum.result() if f["bytes"] is not None],
    }
