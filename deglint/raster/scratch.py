"""Atomic writing of several files: either all are written, or none.

A run writes scratch files in the directory of its outputs and moves them into place when all are complete. Meanwhile
signals are held; a failed move is undone. Runs that end at the same time move their files one after the other, so that
an image and its sidecar are always of the same run. Scratch files of killed runs are removed by the next run with the
same output.
"""

from __future__ import annotations

import contextlib
import glob
import os
import platform
import re
import secrets
import shutil
import signal
import sys
import threading
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError, ReadError, WriteError
from .files import COMPANIONS, real
from .info import gdal_errors, one_line

MOVED: list[Path] = []
"""Outputs that this process has moved into place; a command that is interrupted later reports them."""
_HELD_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP", "SIGXCPU")
"""Signals that are held while files are moved."""
DISK_FULL = "the disk or a quota is full, or files may not grow so large (ulimit -f)"
_LONGEST = 180
"""Bytes of an output's name that its scratch file keeps: the whole name must fit into 255 bytes."""


class Scratch:
    """Files that are written together, or not at all.

    Use as a context manager: leaving the block normally moves every file into place, leaving it by an error removes
    them all. The first file added is moved last: if it exists, so do the others. Existing files are replaced with
    `overwrite` only.
    """

    def __init__(self, *, overwrite: bool = True) -> None:
        self._files: dict[Path, Path] = {}  # scratch files by target
        self._overwrite = overwrite

    def __enter__(self) -> Scratch:
        return self

    def add(self, target: Path) -> Path:
        """Create the name of a scratch file beside `target`."""
        clear_scratch(target)
        self._files[target] = beside(target, "part")
        return self._files[target]

    def file(self, target: Path) -> Path:
        """The scratch file of a target that was added."""
        return self._files[target]

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                with signals_held():
                    self._commit()
        finally:
            _discard(*(Path(f"{file}{ending}") for file in self._files.values() for ending in ("", *COMPANIONS)))

    def _commit(self) -> None:
        umask = os.umask(0)
        os.umask(umask)
        with _one_at_a_time({real(target).parent for target in self._files}):
            for target, scratch in self._files.items():
                if not self._overwrite and os.path.lexists(target):
                    raise WriteError(
                        f"{target} was made by another run meanwhile, and stays. Give --overwrite to replace it."
                    )
                if not scratch.exists():
                    raise WriteError(
                        f"cannot write {target}: what was written for it, {scratch.name}, was taken away meanwhile. "
                        "Nothing was changed; run again."
                    )
            _move([(scratch, real(target)) for target, scratch in reversed(self._files.items())], umask)
        MOVED.extend(self._files)


def _move(files: Sequence[tuple[Path, Path]], umask: int) -> None:
    """Move several files into place, or none; replaced files are kept until all are moved."""
    kept: dict[Path, Path] = {}
    done: list[Path] = []
    try:
        for scratch, target in files:
            scratch.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~umask)
        for _scratch, target in files:
            if target.exists():
                old = beside(target, "old")
                try:
                    os.link(target, old)
                except OSError:  # a file system without links: the name itself is taken
                    target.rename(old)
                    done.append(target)
                kept[target] = old
        for scratch, target in files:
            done.append(target)
            scratch.replace(target)
    except BaseException as error:
        left = _restore(dict.fromkeys(done[::-1]), kept)
        if not isinstance(error, OSError):
            raise
        said = f"{error.strerror or error}: {error.filename2 or error.filename or files[-1][1]}"
        after = "Nothing was changed" if not left else "Not restored: " + "; ".join(left)
        raise WriteError(f"cannot move the result into place: {said}. {after}.") from error
    for _scratch, target in files:  # companions of old files do not hold for the new ones
        _discard(*(Path(f"{target}{ending}") for ending in COMPANIONS))
    _discard(*kept.values())


def _restore(targets: Iterable[Path], kept: Mapping[Path, Path]) -> list[str]:
    """Restore replaced files; return messages on those that cannot be restored."""
    left, stale = [], set(kept.values())
    for target in targets:
        old = kept.get(target)
        try:
            if old is None:
                target.unlink(missing_ok=True)
            elif not (target.exists() and target.samefile(old)):
                try:
                    old.replace(target)
                except OSError:  # renaming is what fails; linking may not
                    target.unlink(missing_ok=True)
                    os.link(old, target)
        except OSError:
            left.append(f"{target}" + (f", whose old content is {old}" if old else ", which is new"))
            stale.discard(old)
    _discard(*stale)
    return left


@contextlib.contextmanager
def signals_held() -> Iterator[None]:
    """Hold signals within the block; afterwards they are raised again.

    This works in the main thread only, where interruptions are raised.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before: dict[int, Any] = {}
    try:
        for name in _HELD_SIGNALS:
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) not in (signal.SIG_IGN, None):
                before[number] = signal.signal(number, lambda which, _frame: came.append(which))
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in dict.fromkeys(came):
            signal.raise_signal(number)


@contextlib.contextmanager
def _one_at_a_time(directories: set[Path]) -> Iterator[None]:
    """Lock the directories, so that only one run moves files at a time; without effect where there are no locks."""
    with contextlib.ExitStack() as stack:
        for directory in sorted(directories):
            with contextlib.suppress(OSError):  # Windows opens no directory
                place = os.open(directory, os.O_RDONLY)
                stack.callback(os.close, place)
                _lock(place, wait=True)
        yield


def make_directory(directory: Path, *, parents: bool = False) -> None:
    """Create a directory for outputs if it is missing."""
    try:
        directory.mkdir(parents=parents, exist_ok=True)
    except OSError as error:
        raise WriteError(f"cannot make the directory {directory}: {error.strerror}. Name another one.") from error


@contextlib.contextmanager
def claimed(directory: Path) -> Iterator[None]:
    """Lock a directory against other batches; the lock ends with the process."""
    path = directory / ".deglint-batch.lock"
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        try:
            _lock(file)
            if path.exists() and os.fstat(file).st_ino == path.stat().st_ino:  # not one that was just taken away
                break
        except BlockingIOError:
            os.close(file)
            raise WriteError(
                f"another batch is writing into {directory}. Wait for it, or give another directory."
            ) from None
        except OSError:  # a file system without locks
            break
        os.close(file)
    try:
        yield
    finally:
        _discard(path)
        os.close(file)


def _lock(file: int, *, wait: bool = False) -> None:
    """Lock an open file; BlockingIOError if another process has the lock, another OSError without locks."""
    if sys.platform == "win32":
        import msvcrt

        try:
            msvcrt.locking(file, msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError from error
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))


def beside(target: Path, ending: str) -> Path:
    """A new hidden name beside an output, with the identity of this process."""
    place = real(target)
    token = f"{_machine():08x}-{os.getpid()}-{secrets.token_hex(4)}"
    return place.with_name(f"{_head(place)}{token}.{ending}{place.suffix[:8]}")


def clear_scratch(target: Path) -> None:
    """Remove scratch files that ended processes of this machine left beside an output.

    A replaced file is restored if the output is missing.
    """
    place = real(target)
    name = re.compile(re.escape(_head(place)) + r"([0-9a-f]{8})-(\d+)-[0-9a-f]{8}\.(part|old)(\.\w+)*")
    with contextlib.suppress(OSError):
        for path in place.parent.glob(f"{glob.escape(_head(place))}*"):
            found = name.fullmatch(path.name)
            if found is None or int(found[1], 16) != _machine() or _alive(int(found[2])):
                continue
            if found[3] == "old" and not place.exists():
                path.rename(place)
            else:
                _discard(path)


def _head(place: Path) -> str:
    """Common beginning of the names of an output's scratch files."""
    return f".{os.fsdecode(os.fsencode(place.name)[:_LONGEST])}."


def _machine() -> int:
    """A number for this machine and, in containers, for the process namespace."""
    try:
        space = Path("/proc/self/ns/pid").stat().st_ino
    except OSError:
        space = 0
    return zlib.crc32(f"{platform.node()} {space}".encode())


def _alive(process: int) -> bool:
    if sys.platform == "win32":
        return True  # os.kill would end the process there, so what it left stays
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        pass
    return True


def _discard(*paths: Path) -> None:
    for path in paths:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)


def free_bytes(directory: Path) -> int | None:
    """Free bytes on a disk; None where not available."""
    try:
        return shutil.disk_usage(directory).free
    except OSError:
        return None


@contextlib.contextmanager
def write_errors(target: Path) -> Iterator[None]:
    """Turn errors while a file is written into one-line errors."""
    try:
        yield
    except gdal_errors(OSError) as error:
        if isinstance(error, WriteError):
            raise
        if isinstance(error, ReadError):  # what was just written cannot be read again
            error = OSError(DISK_FULL)
        raise WriteError(f"cannot write {target}: {_reason(target.parent, error)}") from error
    except (TypeError, ValueError, KeyError) as error:
        raise InputError(f"cannot write {target} with these options: {one_line(error)}.") from error


def _reason(directory: Path, error: BaseException) -> str:
    text = ""
    cause: BaseException | None = error
    while cause is not None:
        text, cause = f"{text} {cause}", cause.__cause__ or cause.__context__
    free = free_bytes(directory)
    if "No space left" in text or (free is not None and free < 1 << 20):
        return f"the disk is full ({directory}). Nothing was changed; free some space."
    if DISK_FULL in text or "rite error" in text:
        return f"{DISK_FULL}. Nothing was changed."
    return f"{one_line(error)}. Nothing was changed."
