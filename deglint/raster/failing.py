"""Errors while a file is written, as one-line messages; a check that the file is complete."""

from __future__ import annotations

import contextlib
import logging
import re
import shutil
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from ..errors import InputError, ReadError, WriteError
from .info import gdal_errors, one_line, open_dataset


def free_bytes(directory: Path) -> int | None:
    """Free bytes on a disk; None where not available."""
    try:
        return shutil.disk_usage(directory).free
    except OSError:
        return None


_SHORT = "the disk or a quota is full, or files may not grow so large (ulimit -f)"


@contextlib.contextmanager
def write_errors(target: Path) -> Iterator[None]:
    """Turn errors while a file is written into one-line errors."""
    try:
        yield
    except gdal_errors(OSError) as error:
        if isinstance(error, WriteError):
            raise
        if isinstance(error, ReadError):  # what was just written cannot be read again
            error = OSError(_SHORT)
        raise WriteError(f"cannot write {target}: {_reason(target.parent, error)}") from error
    except (TypeError, ValueError, KeyError) as error:
        raise InputError(f"cannot write {target} with these options: {one_line(error)}.") from error


@contextlib.contextmanager
def refusals(target: Path, options: Mapping[str, str]) -> Iterator[None]:
    """Turn GDAL's warnings on creation options, unknown or not applicable, into errors."""
    said: list[str] = []
    mine = threading.get_ident()

    def listen(record: logging.LogRecord) -> bool:
        if record.thread == mine and record.levelno >= logging.WARNING:
            said.append(record.getMessage())
        return True

    log = logging.getLogger("rasterio._env")
    log.addFilter(listen)
    try:
        yield
    finally:
        log.removeFilter(listen)
    for line in said:
        if any(re.search(rf"\b{re.escape(name)}\b", line, re.IGNORECASE) for name in options):
            said_of_it = line.rpartition(" in ")[2].rstrip(".")
            raise InputError(f"cannot write {target} with these options: {said_of_it}. Check --co.")


def _reason(directory: Path, error: BaseException) -> str:
    text = ""
    cause: BaseException | None = error
    while cause is not None:
        text, cause = f"{text} {cause}", cause.__cause__ or cause.__context__
    free = free_bytes(directory)
    if "No space left" in text or (free is not None and free < 1 << 20):
        return f"the disk is full ({directory}). Nothing was changed; free some space."
    if _SHORT in text or "rite error" in text:
        return f"{_SHORT}. Nothing was changed."
    return f"{one_line(error)}. Nothing was changed."


def check_whole(path: Path, target: Path) -> None:
    """Check that all blocks are inside the file: GDAL does not report errors when it closes a file."""
    with write_errors(target), open_dataset(str(path)) as dataset:
        size = path.stat().st_size
        planes: Sequence[int] = dataset.indexes if dataset.profile.get("interleave") != "pixel" else [1]
        for band in planes:
            rows, columns = dataset.block_shapes[band - 1]
            across, down = -(-dataset.width // columns), -(-dataset.height // rows)
            for x, y in ((0, 0), (across - 1, 0), (across - 1, down - 1), (across // 2, down // 2)):
                start = dataset.get_tag_item(f"BLOCK_OFFSET_{x}_{y}", "TIFF", bidx=band)
                length = dataset.get_tag_item(f"BLOCK_SIZE_{x}_{y}", "TIFF", bidx=band)
                if start is None or int(start) + int(length or 0) > size:
                    raise OSError(_SHORT)
