"""Files that come into being together, or not at all, whoever else writes beside them.

A run writes into scratch files in the directory of its outputs and moves them into place when all are whole. Runs that
end at the same time move one after the other, so that an image and its sidecar are always of one run.
"""

from __future__ import annotations

import contextlib
import glob
import os
import re
import secrets
from collections.abc import Iterator
from pathlib import Path

from ..errors import WriteError

_COMPANIONS = (".aux.xml", ".msk", ".ovr")
"""What GDAL may put beside a raster."""


def real(path: Path) -> Path:
    """The file that a name stands for, symbolic links followed; it need not exist."""
    return Path(os.path.realpath(path))


class Scratch:
    """Files that come into being together, or not at all.

    Use as a context manager: leaving the block normally moves every file into place, leaving it by an error removes
    them all. The first file added is moved last: where it stands, the others do too.
    """

    def __init__(self, *, overwrite: bool = True) -> None:
        self._files: list[tuple[Path, Path]] = []
        self._overwrite = overwrite

    def __enter__(self) -> Scratch:
        return self

    def add(self, target: Path) -> Path:
        """Name of a scratch file beside `target`."""
        place = real(target)
        scratch = place.with_name(f".{place.name[:200]}.{secrets.token_hex(4)}.part{place.suffix[:8]}")
        self._files.append((scratch, target))
        return scratch

    def file(self, target: Path) -> Path:
        """Where a file that was added is written for now."""
        return next(scratch for scratch, known in self._files if known == target)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._commit()
        finally:
            for scratch, _target in self._files:
                for ending in ("", *_COMPANIONS):
                    _discard(Path(f"{scratch}{ending}"))

    def _commit(self) -> None:
        umask = os.umask(0)
        os.umask(umask)
        try:
            with _one_at_a_time({real(target).parent for _scratch, target in self._files}):
                self._refuse_what_came_between()
                for scratch, target in reversed(self._files):
                    if not scratch.exists():
                        continue
                    scratch.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~umask)
                    for ending in _COMPANIONS:  # of an old file: they do not hold for the new one
                        _discard(Path(f"{real(target)}{ending}"))
                    scratch.replace(real(target))
        except OSError as error:
            if isinstance(error, WriteError):
                raise
            raise WriteError(f"cannot move the result into place: {error}") from error

    def _refuse_what_came_between(self) -> None:
        """Without leave to overwrite, a file that another run put there while this one worked stays."""
        for _scratch, target in () if self._overwrite else self._files:
            if target.exists():
                raise WriteError(
                    f"{target} was made by another run meanwhile, and stays. Give --overwrite to replace it."
                )


@contextlib.contextmanager
def _one_at_a_time(directories: set[Path]) -> Iterator[None]:
    """Files of one run are moved into place with none of another run's between them, where the system knows locks."""
    with contextlib.ExitStack() as stack:
        for directory in sorted(directories):
            with contextlib.suppress(ImportError, OSError):
                import fcntl

                place = os.open(directory, os.O_RDONLY)
                stack.callback(os.close, place)
                fcntl.flock(place, fcntl.LOCK_EX)
        yield


@contextlib.contextmanager
def claimed(directory: Path) -> Iterator[None]:
    """Hold a directory against other batches; the claim ends with the process, however that ends.

    Raises
    ------
    WriteError
        Another batch is at work in it.
    """
    import fcntl

    path = directory / ".deglint-batch.lock"
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
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


def clear_scratch(target: Path) -> None:
    """Remove what runs that were killed left beside an output; only for one whose directory is claimed."""
    place = real(target)
    name = re.compile(rf"\.{re.escape(place.name[:200])}\.[0-9a-f]{{8}}\.part{re.escape(place.suffix[:8])}(\.\w+)*")
    with contextlib.suppress(OSError):
        for path in place.parent.glob(f".{glob.escape(place.name[:200])}.*"):
            if name.fullmatch(path.name):
                _discard(path)


def _discard(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink(missing_ok=True)
