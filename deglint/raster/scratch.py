"""Atomic writing of several files: either all are written, or none.

A run writes scratch files in the directory of its outputs and renames them when all are complete. Signals are held
while files are renamed. If one cannot be renamed, the earlier ones get their old names again. Scratch files of killed
runs are removed by the next run with the same output.
"""

from __future__ import annotations

import contextlib
import glob
import os
import secrets
import shutil
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..errors import InputError, ReadError, WriteError
from .info import gdal_errors, one_line
from .targets import COMPANIONS

_HELD_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")  # signals that are held while files are moved
DISK_FULL = "the disk or a quota is full, or files may not grow so large (ulimit -f)"


class Scratch:
    """Files that are written together, or not at all.

    Use as a context manager: at the end of the block every scratch file is moved into place; after an error all scratch
    files are removed. The file added first is moved last: once it is in place, all others are. Existing files are
    replaced only with `overwrite`.
    """

    def __init__(self, *, overwrite: bool = True) -> None:
        self._files: dict[Path, Path] = {}  # scratch files by target
        self._overwrite = overwrite

    def __enter__(self) -> Scratch:
        return self

    def add(self, target: Path) -> Path:
        """Return the path of a new scratch file in the directory of `target`; the caller writes that file."""
        _clear_scratch(target.resolve())
        self._files[target] = _beside(target.resolve(), "part")
        return self._files[target]

    def file(self, target: Path) -> Path:
        """Path of the scratch file of a target that was added."""
        return self._files[target]

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                with _signals_held():
                    self._commit()
        finally:
            _discard(*(Path(f"{file}{ending}") for file in self._files.values() for ending in ("", *COMPANIONS)))

    def _commit(self) -> None:
        """Rename every scratch file to its target; after an error, undo this in reverse order and raise WriteError."""
        made = next((target for target in self._files if os.path.lexists(target)), None)
        if made is not None and not self._overwrite:
            raise WriteError(f"{made} was made by another run meanwhile, and stays. Give --overwrite to replace it.")
        kept: list[Path] = []
        done: list[tuple[Path, Path]] = []
        places = [(scratch, target.resolve()) for target, scratch in reversed(self._files.items())]
        try:
            for scratch, target in places:
                if target.exists():
                    scratch.chmod(target.stat().st_mode & 0o777)
                    kept.append(_beside(target, "old"))
                    target.replace(kept[-1])
                    done.append((target, kept[-1]))
                scratch.replace(target)
                done.append((scratch, target))
        except OSError as error:
            after = "Nothing was changed"
            for old, new in reversed(done):
                try:
                    new.replace(old)
                except OSError:
                    after = f"{old} is now {new}"
            said = f"{error.strerror or error}: {error.filename2 or error.filename or places[-1][1]}"
            raise WriteError(f"cannot move the result into place: {said}. {after}.") from error
        for _scratch, target in places:  # companions of old files do not hold for the new ones
            _discard(*(Path(f"{target}{ending}") for ending in COMPANIONS))
        _discard(*kept)


@contextlib.contextmanager
def _signals_held() -> Iterator[None]:
    """Hold signals that arrive within the block, and raise them at its end.

    This has an effect in the main thread only, as Python handles signals there.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before: dict[int, Any] = {}
    try:
        for number in (getattr(signal, name) for name in _HELD_SIGNALS if hasattr(signal, name)):
            if signal.getsignal(number) is not None:
                before[number] = signal.signal(number, lambda which, _frame: came.append(which))
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in dict.fromkeys(came):
            signal.raise_signal(number)


def make_directory(directory: Path, *, parents: bool = False) -> None:
    """Create a directory for outputs if it is missing; WriteError if that fails."""
    try:
        directory.mkdir(parents=parents, exist_ok=True)
    except OSError as error:
        raise WriteError(f"cannot make the directory {directory}: {error.strerror}. Name another one.") from error


@contextlib.contextmanager
def claimed(directory: Path) -> Iterator[None]:
    """Lock a directory against other batches during the block; WriteError if another batch holds the lock."""
    path = directory / ".deglint-batch.lock"
    with path.open("wb") as file:
        try:
            if sys.platform == "win32":
                import msvcrt

                msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError):
            raise WriteError(f"another batch is writing into {directory}. Wait, or give another directory.") from None
        except OSError:  # a file system without locks
            pass
        try:
            yield
        finally:
            _discard(path)


def _beside(place: Path, ending: str) -> Path:
    """A new hidden name in the directory of an output (`place`), with the number of this process in it."""
    return place.with_name(f".{place.name}.{os.getpid()}-{secrets.token_hex(4)}.{ending}{place.suffix}")


def _clear_scratch(place: Path) -> None:
    """Remove scratch files of an output (`place`) whose processes have ended."""
    if sys.platform == "win32":
        return  # os.kill would end the process there
    for path in place.parent.glob(f".{glob.escape(place.name)}.*-*.part*"):
        try:
            os.kill(int(path.name.removeprefix(f".{place.name}.").partition("-")[0]), 0)
        except ProcessLookupError:
            _discard(path)
        except (OSError, ValueError):
            pass


def _discard(*paths: Path) -> None:
    for path in paths:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)


@contextlib.contextmanager
def write_errors(target: Path) -> Iterator[None]:
    """Turn errors that occur while `target` is written into WriteError or InputError with one line of text."""
    try:
        yield
    except WriteError:
        raise
    except gdal_errors(OSError) as error:
        text = " ".join(map(str, (error, error.__cause__, error.__context__)))
        if "No space left" in text or shutil.disk_usage(target.parent).free < 1 << 20:
            why = f"the disk is full ({target.parent}); free some space"
        elif isinstance(error, ReadError) or DISK_FULL in text or "rite error" in text:
            why = DISK_FULL  # a ReadError: what was just written cannot be read again
        else:
            why = one_line(error)
        raise WriteError(f"cannot write {target}: {why}. Nothing was changed.") from error
    except (TypeError, ValueError, KeyError) as error:
        raise InputError(f"cannot write {target} with these options: {one_line(error)}.") from error
