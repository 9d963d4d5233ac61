"""An image written in parts by many processes, and put together by one.

Each part holds the pixels of one tile, uncompressed, in a file of NumPy's.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import WriteError
from ..scene import Window
from .failing import write_errors
from .output import Layout, RasterWriter, finishing
from .scratch import Scratch


@dataclass(frozen=True)
class Part:
    """A tile's pixels in a file of their own, with a mask where the image has one."""

    path: Path


def write_part(path: Path, block: npt.NDArray[Any], valid: npt.NDArray[np.bool_] | None) -> Part:
    """Write a tile's pixels as a part of an image, and which of them are valid."""
    with write_errors(path), path.open("wb") as file:
        for array in (block,) if valid is None else (block, valid):
            np.lib.format.write_array(file, array, allow_pickle=False)
    return Part(path)


class PartWriter:
    """A `RasterWriter` whose blocks come as parts."""

    def __init__(self, writer: RasterWriter) -> None:
        self._writer = writer
        self.close, self.abort = writer.close, writer.abort

    def write(self, part: Part, window: Window) -> None:
        """Put a part where it belongs."""
        try:
            with part.path.open("rb") as file:
                many = 2 if self._writer.layout.masked else 1
                block, *valid = (np.lib.format.read_array(file, allow_pickle=False) for _ in range(many))
        except OSError as error:
            raise WriteError(
                f"a tile that a worker wrote is not in {part.path.parent}: workers and this process need the same file "
                "system."
            ) from error
        self._writer.write(block, window)
        if valid:
            self._writer.write_mask(valid[0], window)


def writing_parts(scratch: Scratch, target: Path, layout: Layout) -> contextlib.AbstractContextManager[PartWriter]:
    """A `PartWriter` that finishes."""
    return finishing(PartWriter(RasterWriter(scratch.add(target), target, layout)))
