"""Check which output files may be written, and write several files atomically: either all of them, or none.

An output never replaces an input file or a file that GDAL reads with it (nested sources of VRTs included), and replaces
another existing file only if `overwrite` is True. Files are compared by device and inode, so that links and other
spellings are recognised; names of files that do not exist are compared as resolved paths.

A run writes scratch files in the directory of its outputs and renames them when all are complete. If one cannot be
renamed, or after Ctrl-C, those already renamed get their old names again. Scratch files of killed runs are removed by
the next run with the same output.
"""

import contextlib
import glob
import os
import re
import secrets
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from ..errors import InputError, ReadError, WriteError
from .info import REMOTE_NAME, gdal_errors, one_line, open_dataset

COMPANIONS = (".aux.xml", ".msk", ".ovr")  # endings of files beside a raster that GDAL reads with it
_GDAL_PREFIX = re.compile(r"^(/?vsi\w+/)+|^[\w+]+://", re.IGNORECASE)
_PLAIN_TEXT = (".json", ".geojson", ".toml", ".csv")
OTHER_FORMATS = frozenset(  # endings that a GeoTIFF should not have
    (".bmp", ".dat", ".gif", ".h5", ".hdf", ".img", ".jp2", ".jpeg", ".jpg", ".nc", ".png", ".vrt", ".webp", ".zarr")
)
Reads = Mapping[str, Iterable[str | Path]]  # names of input files, by their role: "the input", "--mask"
DISK_FULL = "the disk or a quota is full, or files may not grow so large (ulimit -f)"


def identity(path: str | Path) -> tuple[int, int] | str:
    """Value that is equal for all names of a file: device and inode, or the resolved path if it does not exist."""
    with contextlib.suppress(OSError, ValueError):
        found = Path(path).stat()
        return found.st_dev, found.st_ino
    return os.path.realpath(path)


def files_behind(names: Iterable[str | Path]) -> tuple[str, ...]:
    """All files that are read if the inputs `names` are read: first the names, then the files that belong to them.

    Names are GDAL names, folders or text files. Files that belong to a name are, for example, the sources of a VRT, or
    the archive that contains a file. Names that are not files ("auto", "0,0,10,10") or cannot be opened have none.
    """
    given = dict.fromkeys(map(str, names))
    found = {identity(name): name for name in reversed(given)}
    for name in given:
        for file in _read_with(name):
            found.setdefault(identity(file), file)
    return (*given, *(file for file in found.values() if file not in given))


def _read_with(name: str) -> Iterator[str]:
    """Files that GDAL reads for the raster `name` and for VRTs among its sources, and archives that contain them."""
    yield from _local(name)
    waiting, seen = [name, *_local(name)], set[str]()
    while waiting:
        file = waiting.pop()
        if file in seen or REMOTE_NAME.match(file) or file.lower().endswith(_PLAIN_TEXT):
            continue
        seen.add(file)
        try:
            with open_dataset(file) as dataset:
                listed, mosaic = dataset.files, dataset.driver == "VRT"
        except (InputError, ReadError, UnicodeDecodeError):  # the last: a VRT whose sources have names in no encoding
            continue
        for other in listed:
            yield from (other, *_local(other))
            if mosaic:
                stem = os.path.splitext(other)[0]  # noqa: PTH122  (sources are not opened: there may be ten thousand)
                beside = *(f"{other}{ending}" for ending in (*COMPANIONS, ".hdr")), f"{stem}.hdr"
                yield from filter(os.path.exists, beside)
        waiting += [other for other in listed if mosaic and other.lower().endswith(".vrt")]


def _local(name: str) -> list[str]:
    """List with the local file or archive inside a GDAL name: a.zip for "/vsizip/a.zip/b.tif"; [] for a plain name."""
    bare = Path(_GDAL_PREFIX.sub("", name.split("?")[0]).replace("!", "/"))
    if os.path.exists(name) or str(bare) == name:  # noqa: PTH110  (raises for no name)
        return []
    return [str(place) for place in (bare, *bare.parents) if os.path.isfile(place)]  # noqa: PTH113  (as above)


def check_targets(targets: Sequence[Path], reads: Reads | None = None, *, overwrite: bool = False) -> None:
    """Raise InputError or WriteError, before anything is written, if an output cannot or may not be written.

    Outputs must be different files, and none may have the name of a file that GDAL reads with another output or an
    input (`COMPANIONS`). `reads` has all input names by role; names that are not files ("auto") are skipped. Inputs and
    the files that belong to them (`files_behind`) are never replaced; other files only if `overwrite` is True.
    """
    taken: set[tuple[int, int] | str] = set()
    for target in targets:
        if identity(target) in taken:
            raise InputError(f"two outputs have the same name, {target}; give each its own.")
        taken.add(identity(target))
    check_unread(targets, reads or {})
    for target in targets:
        check_target(target, overwrite=overwrite)


def check_unread(targets: Sequence[Path], reads: Reads) -> None:
    """Raise InputError if an output would replace or delete an input file, or be read as a part of another file."""
    held: dict[tuple[int, int] | str, str] = {}
    beside = {identity(companion): str(target) for target in targets for companion in _companions(target)}
    for what, names in reads.items():
        given = [str(name) for name in names]
        for file in files_behind(given):
            held.setdefault(identity(file), f"is {what}" if file in given else f"is read with {what}")
            beside |= {identity(companion): file for companion in _companions(Path(file))}
    for target in targets:
        for path in (target, *_companions(target)):  # when an image is replaced, its old companions are deleted
            if found := held.get(identity(path)):
                raise InputError(f"{path} {found}: it would be written over, and would be lost. Give another name.")
        if (whose := beside.get(identity(target))) is not None:
            raise InputError(f"{target} would be read as a part of {whose}. Give that output another name.")


def _companions(path: Path) -> list[Path]:
    return [Path(f"{path}{ending}") for ending in COMPANIONS]


def check_target(path: Path, *, overwrite: bool) -> None:
    """Raise WriteError if an output cannot be written or, without `overwrite`, if it or one of `COMPANIONS` exists."""
    if re.match(r"-$|/vsi|[A-Za-z][\w+.-]+:/", str(path)):
        raise WriteError(f"cannot write to {path}: outputs are local files. Write it here and copy it there.")
    if path.is_dir():
        raise WriteError(f"{path} is a directory; name a file in it, such as {path / 'out.tif'}.")
    directory = path.resolve().parent
    if file := next((place for place in (directory, *directory.parents) if place.is_file()), None):
        raise WriteError(f"{file} is a file, not a directory. Choose another place for {path.name}.")
    if not directory.is_dir():
        raise WriteError(f"the directory {directory} does not exist. Make it first: mkdir -p {directory}")
    if not os.access(directory, os.W_OK | os.X_OK):
        raise WriteError(f"no permission to write in {directory}. Choose another place for {path.name}.")
    if path.exists() and not path.is_file():
        raise WriteError(f"{path} is not a regular file, and would be replaced by one. Name another output.")
    found = [file for file in (path, *_companions(path)) if file.exists()]  # all of which would be replaced
    if found and not overwrite:
        raise WriteError(f"{found[0]} exists already. Give --overwrite (in Python overwrite=True), or another name.")


def check_images(*paths: Path | None) -> None:
    """Raise WriteError if the name of a GeoTIFF has the ending of another format, such as .png; None is skipped."""
    for path in paths:
        if path is not None and path.suffix.lower() in (*OTHER_FORMATS, *_PLAIN_TEXT):
            check_ending(path, "a GeoTIFF", ".tif")


def check_ending(path: Path | None, what: str, *endings: str) -> None:
    """Raise WriteError if a name, unless it is None, has none of the endings; the message calls the content `what`."""
    if path is not None and path.suffix.lower() not in endings:
        name = path.with_suffix(endings[0]).name
        raise WriteError(f"{path}: this output is {what}. Name it {name}.")


class Scratch(contextlib.AbstractContextManager["Scratch"]):
    """Write several files together, or none of them.

    Use it as a context manager: at the end of the block, every scratch file is renamed to its target; after an error
    all scratch files are removed. The file that was added first is renamed last: once it has its new name, all others
    have, too. Existing files are replaced only with `overwrite`.
    """

    def __init__(self, *, overwrite: bool = True) -> None:
        self._files: dict[Path, Path] = {}  # scratch files by target
        self._overwrite = overwrite

    def add(self, target: Path) -> Path:
        """Return the path of a scratch file to write; at the end of the `with` block it is renamed to `target`."""
        _clear_scratch(target.resolve())
        self._files[target] = _beside(target.resolve(), "part")
        return self._files[target]

    def file(self, target: Path) -> Path:
        """Path of the scratch file that `add` made for a target."""
        return self._files[target]

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._commit()
        finally:
            _discard(*(Path(f"{file}{ending}") for file in self._files.values() for ending in ("", *COMPANIONS)))

    def _commit(self) -> None:
        """Rename all scratch files to their targets; undo this after an error. OSError is raised as WriteError."""
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
                    done.append((target, kept[-1]))  # noted first: an interruption may follow the move at once
                    target.replace(kept[-1])
                done.append((scratch, target))
                scratch.replace(target)
        except BaseException as error:
            after = "Nothing was changed"
            for old, new in reversed([move for move in done if move[1].exists()]):
                try:
                    new.replace(old)
                except OSError:
                    after = f"{old} is now {new}"
            if not isinstance(error, OSError):
                raise
            said = f"{error.strerror or error}: {error.filename2 or error.filename or places[-1][1]}"
            raise WriteError(f"cannot move the result into place: {said}. {after}.") from error
        fresh = {target for _scratch, target in places}
        _discard(*(beside for target in fresh for beside in _companions(target) if beside not in fresh))  # of old files
        _discard(*kept)


def make_directory(directory: Path, *, parents: bool = False) -> None:
    """Create a missing directory for outputs; with `parents`, its parents, too. Raises WriteError if that fails."""
    try:
        directory.mkdir(parents=parents, exist_ok=True)
    except OSError as error:
        raise WriteError(f"cannot make the directory {directory}: {error.strerror}. Name another one.") from error


@contextlib.contextmanager
def claimed(directory: Path) -> Iterator[None]:
    """Lock a directory against other batches in a `with` block; WriteError if another batch has locked it."""
    path = directory / ".deglint-batch.lock"
    with contextlib.ExitStack() as stack:
        while True:
            file = stack.enter_context(path.open("wb"))
            try:
                if sys.platform == "win32":
                    import msvcrt

                    msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
                    break
                import fcntl

                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except (BlockingIOError, PermissionError):
                raise WriteError(f"another batch is writing into {directory}. Wait, or choose another.") from None
            except OSError:  # a file system without locks
                break
            held = os.fstat(file.fileno())
            if identity(path) == (held.st_dev, held.st_ino):
                break  # else another batch has removed this file at its end, so that a new one is locked
        stack.callback(_discard, path)
        yield


def _beside(place: Path, ending: str) -> Path:
    """New hidden file name beside the output `place`, such as ".a.tif.PID-RANDOM.part.tif" for the `ending` "part"."""
    return place.with_name(f".{place.name}.{os.getpid()}-{secrets.token_hex(4)}.{ending}{place.suffix}")


def _clear_scratch(place: Path) -> None:
    """Remove scratch files of the output `place` that belong to processes which have ended."""
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
    """In a `with` block that writes `target`, raise errors of GDAL or disk as WriteError, of options as InputError."""
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
