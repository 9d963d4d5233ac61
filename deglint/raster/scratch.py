"""Files that come into being together, or not at all, whoever else writes beside them.

A run writes into scratch files in the directory of its outputs and moves them into place when all are whole. While they
are moved, signals wait; what fails is undone. Runs that end at the same time move one after the other, so that an image
and its sidecar are always of one run. What runs that were killed left beside an output goes with the next run of it.
"""

from __future__ import annotations

import contextlib
import glob
import os
import platform
import re
import secrets
import signal
import sys
import threading
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ..errors import WriteError
from .local import COMPANIONS, real

MOVED: list[Path] = []
"""Outputs that this process has moved into place: what a command that is interrupted later has written all the same."""
_HELD_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP", "SIGXCPU")
"""Signals that wait while files are moved."""
_LONGEST = 180
"""Bytes of an output's name that its scratch keeps: what is added has to fit into the 255 that systems allow."""


class Scratch:
    """Files that come into being together, or not at all.

    Use as a context manager: leaving the block normally moves every file into place, leaving it by an error removes
    them all. The first file added is moved last: where it stands, the others do too.

    Parameters
    ----------
    overwrite : bool
        Replace files that are there by then.
    """

    def __init__(self, *, overwrite: bool = True) -> None:
        self._files: list[tuple[Path, Path]] = []
        self._overwrite = overwrite

    def __enter__(self) -> Scratch:
        return self

    def add(self, target: Path) -> Path:
        """Name of a scratch file beside `target`."""
        clear_scratch(target)
        scratch = beside(target, "part")
        self._files.append((scratch, target))
        return scratch

    def file(self, target: Path) -> Path:
        """Where a file that was added is written for now."""
        return next(scratch for scratch, known in self._files if known == target)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                with signals_held():
                    self._commit()
        finally:
            for scratch, _target in self._files:
                for ending in ("", *COMPANIONS):
                    _discard(Path(f"{scratch}{ending}"))

    def _commit(self) -> None:
        umask = os.umask(0)
        os.umask(umask)
        move = _Move([(scratch, real(target)) for scratch, target in reversed(self._files)])
        with _one_at_a_time({real(target).parent for _scratch, target in self._files}):
            for scratch, target in self._files:
                if not self._overwrite and os.path.lexists(target):
                    raise WriteError(
                        f"{target} was made by another run meanwhile, and stays. Give --overwrite to replace it."
                    )
                if not scratch.exists():
                    raise WriteError(
                        f"cannot write {target}: what was written for it, {scratch.name}, was taken away meanwhile. "
                        "Nothing was changed; run again."
                    )
            move.all(umask)
        MOVED.extend(target for _scratch, target in self._files)


class _Move:
    """Several files moved into place, or none: what was there before is kept until all are."""

    def __init__(self, files: Sequence[tuple[Path, Path]]) -> None:
        self._files = files
        self._kept: dict[Path, Path] = {}
        self._done: list[Path] = []

    def all(self, umask: int) -> None:
        """Move them."""
        try:
            for scratch, target in self._files:
                scratch.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~umask)
            for _scratch, target in self._files:
                self._keep(target)
            for scratch, target in self._files:
                self._done.append(target)
                scratch.replace(target)
        except BaseException as error:
            left = self._undo()
            if not isinstance(error, OSError):
                raise
            said = f"{error.strerror or error}: {error.filename2 or error.filename or self._files[-1][1]}"
            after = "Nothing was changed" if not left else "Not restored: " + "; ".join(left)
            raise WriteError(f"cannot move the result into place: {said}. {after}.") from error
        for _scratch, target in self._files:  # companions of old files do not hold for the new ones
            for ending in COMPANIONS:
                _discard(Path(f"{target}{ending}"))
        for kept in self._kept.values():
            _discard(kept)

    def _keep(self, target: Path) -> None:
        """A second name for what is there."""
        if not target.exists():
            return
        kept = beside(target, "old")
        try:
            os.link(target, kept)
        except OSError:  # a file system without links: the name itself is taken
            target.rename(kept)
            self._done.append(target)
        self._kept[target] = kept

    def _undo(self) -> list[str]:
        """Put back what was there; says what cannot be."""
        left = []
        for target in dict.fromkeys(self._done[::-1]):
            kept = self._kept.get(target)
            try:
                if kept is None:
                    target.unlink(missing_ok=True)
                elif not (target.exists() and target.samefile(kept)):
                    _put_back(kept, target)
            except OSError:
                left.append(f"{target}" + (f", whose old content is {kept}" if kept else ", which is new"))
                self._kept.pop(target, None)
        for kept in self._kept.values():
            _discard(kept)
        return left


def _put_back(kept: Path, target: Path) -> None:
    try:
        kept.replace(target)
    except OSError:  # renaming is what fails; linking may not
        target.unlink(missing_ok=True)
        os.link(kept, target)


@contextlib.contextmanager
def signals_held() -> Iterator[None]:
    """Let signals wait until the block is left; then they do what they would have done.

    Only the main thread may say so, and only there an interruption is raised.
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
    """Files of one run are moved into place with none of another run's between them, where the system knows locks."""
    with contextlib.ExitStack() as stack:
        for directory in sorted(directories):
            with contextlib.suppress(OSError):  # Windows opens no directory
                place = os.open(directory, os.O_RDONLY)
                stack.callback(os.close, place)
                _lock(place, wait=True)
        yield


def make_directory(directory: Path, *, parents: bool = False) -> None:
    """Make a directory of outputs, where it is missing."""
    try:
        directory.mkdir(parents=parents, exist_ok=True)
    except OSError as error:
        raise WriteError(f"cannot make the directory {directory}: {error.strerror}. Name another one.") from error


@contextlib.contextmanager
def claimed(directory: Path) -> Iterator[None]:
    """Hold a directory against other batches; the claim ends with the process, however that ends."""
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
    """Lock an open file; BlockingIOError where another process holds it, another OSError where there are no locks."""
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
    """A new hidden name beside an output, which tells the process that it is of."""
    place = real(target)
    token = f"{_machine():08x}-{os.getpid()}-{secrets.token_hex(4)}"
    return place.with_name(f"{_head(place)}{token}.{ending}{place.suffix[:8]}")


def clear_scratch(target: Path) -> None:
    """Remove what runs of this machine that are no more left beside an output.

    What was there before an output was moved, and is there no more, comes back.
    """
    place = real(target)
    # names without machine and process are those of versions before 0.2
    name = re.compile(re.escape(_head(place)) + r"(?:([0-9a-f]{8})-(\d+)-)?[0-9a-f]{8}\.(part|parts|old)(\.\w+)*")
    with contextlib.suppress(OSError):
        for path in place.parent.glob(f"{glob.escape(_head(place))}*"):
            found = name.fullmatch(path.name)
            if found is None or (found[1] and (int(found[1], 16) != _machine() or _alive(int(found[2])))):
                continue
            if found[3] == "old" and not place.exists():
                path.rename(place)
            elif path.is_dir():
                for part in path.iterdir():
                    _discard(part)
                path.rmdir()
            else:
                _discard(path)


def _head(place: Path) -> str:
    """How names of an output's scratch begin."""
    return f".{os.fsdecode(os.fsencode(place.name)[:_LONGEST])}."


def _machine() -> int:
    """A number for this machine and, where there are containers, the one in which its processes have their numbers."""
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
        return True
    return True


def _discard(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink(missing_ok=True)
