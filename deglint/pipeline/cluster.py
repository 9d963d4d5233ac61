"""Pass over a scene's tiles on the workers of a dask cluster: processes of this machine, or other machines.

A `Cluster` does what `deglint.tiles.run` does on threads. Every worker opens the input for itself, and what tells of a
tile travels as small numbers. A tile's pixels go by way of files beside the output: the worker compresses and writes
them there, and their blocks are copied into the output as they are. A worker that dies loses the tiles it was at:
others do them again, with the same result.
"""

from __future__ import annotations

import logging
import os
import re
import secrets
import shutil
import socket
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any

from ..errors import DeglintError, InputError, WriteError
from ..raster.environment import environment
from ..raster.output import Layout, Scratch, write_part, writing, writing_parts
from ..raster.scratch import beside
from ..tiles import Combine, Run, Tile, hull, rows_of
from ..tiles import run as run_on_threads

TILES_AHEAD = 3
"""Tiles that each thread of a worker has been given, or has done and not been asked for."""
WORKER_PATIENCE = 60.0
"""How long a run waits for a worker when there is none [s]."""
_POLL = 5.0
_RECOUNT = 16
_CONNECT = 15.0
_NO_WORKER = f"the cluster has had no worker for {WORKER_PATIENCE:g} s. Start some."
_KILLED = (
    "a tile has brought down several workers, most likely for want of memory. Give each worker more memory, or fewer "
    "threads."
)
_LOST = "lost the cluster: its scheduler does not answer any more. Start one, and give the command again."


@dataclass(frozen=True, eq=False)
class Cluster:
    """Workers to pass over tiles; made by `connect`, which starts or reaches them when they are first needed."""

    start: Callable[[], Any]

    @cached_property
    def client(self) -> Any:
        """The `distributed.Client`."""
        return self.start()

    def run(
        self, everything: Sequence[Tile], work: Callable[[Tile], Any], *,
        progress: Callable[[int, int], None] | None = None, combine: Combine | None = None, **_of_threads: Any,
    ) -> Iterator[tuple[Tile, Any]]:  # fmt: skip
        """Do work on every tile and yield (tile, result) in order, as `deglint.tiles.run` does.

        Its options of threads are not used: threads are those of the workers, and each task enters GDAL's environment
        by itself. What `combine` makes of a row of tiles is made on a worker, to which the others send theirs: it alone
        comes here.

        Raises
        ------
        DeglintError
            What the work itself raised; or there are no workers any more, or too little memory.
        """
        import cloudpickle

        shipped = self.client.submit(bytes, cloudpickle.dumps(work), key=f"deglint-work-{secrets.token_hex(8)}")
        rows = [[tile] for tile in everything] if combine is None else rows_of(everything)
        todo, waiting = iter(rows), deque[tuple[list[Tile], Any]]()
        done = given = most = 0
        counted = -_RECOUNT
        try:
            for _ in rows:
                if done - counted >= _RECOUNT:
                    with _scheduler():
                        counted, most = done, TILES_AHEAD * max(sum(self.client.nthreads().values()), 1)
                while given - done < most and (row := next(todo, None)) is not None:
                    found = [self.client.submit(_do, shipped, tile, pure=False) for tile in row]  # stays on the workers
                    future = found[0] if combine is None else self.client.submit(combine, found, pure=False)
                    waiting.append((row, future))
                    del found, future
                    given += len(row)
                row, future = waiting.popleft()
                yield hull(row), self._result(future)
                del future
                done += len(row)
                if progress:
                    progress(done, len(everything))
        finally:
            self.client.cancel([future for _row, future in waiting])  # what they wait for is then wanted by nobody

    @contextmanager
    def by_files(self, target: Path, layouts: Mapping[str, Layout]) -> Iterator[Run]:
        """`run` for results that hold images, as parts beside `target`, which are removed.

        `layouts` has what the images are like, by the names of the results' fields.
        """
        try:
            folder = beside(target, "parts")
            folder.mkdir(mode=0o700)
        except OSError as error:
            raise WriteError(f"cannot write beside {target}: {error.strerror or error}.") from error
        try:
            folder.chmod(0o777 & ~_umask())  # workers may be other users
            yield partial(self._run_by_files, folder, layouts)
        finally:
            _remove(folder)

    def _run_by_files(
        self, folder: Path, layouts: Mapping[str, Layout], everything: Sequence[Tile], work: Callable[[Tile], Any],
        **options: Any,
    ) -> Iterator[tuple[Tile, Any]]:  # fmt: skip
        for tile, done in self.run(everything, _ToFiles(work, folder, layouts), **options):
            yield tile, done
            for part in (getattr(done, name) for name in layouts):
                if part is not None:
                    part.unlink(missing_ok=True)  # gives the disk back

    def _result(self, future: Any) -> Any:
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError
        from distributed.comm import CommClosedError

        without = time.monotonic()
        while True:
            try:
                return future.result(timeout=_POLL)
            except TimeoutError as error:
                try:
                    if future.done():  # just now; or the work itself has run out of time
                        return future.result()
                    threads = self.client.nthreads()
                except (FutureCancelledError, CommClosedError) as lost:
                    raise DeglintError(_LOST) from lost
                if threads:
                    without = time.monotonic()
                elif time.monotonic() - without > WORKER_PATIENCE:
                    raise DeglintError(_NO_WORKER) from error
            except KilledWorker as error:
                raise DeglintError(_KILLED) from error
            except (FutureCancelledError, OSError) as error:
                if isinstance(error, DeglintError):
                    raise
                raise DeglintError(_LOST) from error

    def memory(self) -> dict[str, int]:
        """Most memory that each worker process has held so far [byte]; empty where none was needed."""
        with _scheduler():
            return dict(self.client.run(_peak)) if "client" in vars(self) else {}

    def numbers(self) -> dict[str, Any]:
        """What the sidecar says of the workers: how many there are, and the most memory that one has held so far."""
        held = self.memory().values()
        return {"workers": len(held), "most_memory_of_one_MB": round(max(held, default=0) / 1e6, 1)}


@contextmanager
def writing_images(
    scratch: Scratch, target: Path, images: Mapping[str, tuple[Path, Layout]], cluster: Cluster | None
) -> Iterator[tuple[Run, dict[str, Any]]]:
    """What passes over the tiles, and what writes each image: on threads, or as parts from the workers of a cluster.

    Parameters
    ----------
    scratch : Scratch
    target : Path
        Beside which parts may lie for a while.
    images : mapping
        By the fields of a tile's result: their names, and what they are like.
    cluster : Cluster, optional
    """
    with ExitStack() as stack:
        run: Run = run_on_threads
        way: Any = writing
        if cluster is not None:
            layouts = {what: layout for what, (_path, layout) in images.items()}
            run, way = stack.enter_context(cluster.by_files(target, layouts)), writing_parts
        yield run, {what: stack.enter_context(way(scratch, *image)) for what, image in images.items()}


@contextmanager
def connect(address: str | None = None, *, workers: int | None = None, memory: str = "auto") -> Iterator[Cluster]:
    """Connect to a cluster, or start one of this machine's processes for as long as it is needed.

    Parameters
    ----------
    address : str, optional
        Of a dask scheduler, such as "tcp://10.0.0.5:8786". Workers must have deglint, and see the input and the
        output's directory under the same names.
    workers : int, optional
        In place of an address: so many processes of this machine, of one thread each.
    memory : str
        Limit of each such process, such as "1GiB"; "auto" gives each its share of the machine's. A process over its
        limit is ended, and its tiles are done again.

    Raises
    ------
    DeglintError
        `distributed` is not installed, or there is no scheduler or worker.
    InputError
        Neither, or both, of `address` and `workers`.

    Examples
    --------
    >>> with connect(workers=4) as cluster:  # doctest: +SKIP
    ...     remove_glint("scene.tif", "clean.tif", cluster=cluster)
    """
    if (address is None) == (workers is None):
        raise InputError("want the address of a cluster or a number of workers, one of the two.")
    if workers is not None and workers < 1:
        raise InputError(f"workers: want at least 1, got {workers}.")
    if not re.fullmatch(r"auto|\d+(\.\d+)? ?[kKMGT]i?B", memory):
        raise InputError(f"memory of a worker: want a number and its unit, such as 1GiB or 800MB, got {memory!r}.")
    try:
        from distributed import Client, LocalCluster
    except ModuleNotFoundError as error:
        raise DeglintError(
            "a cluster needs dask's distributed. Install it with: pip install 'deglint[cluster]'"
        ) from error
    if address is not None and not re.fullmatch(r"\w+://\S+:\d+", address):
        raise InputError(f"the address of a cluster looks like tcp://HOST:PORT, got {address!r}.")
    _quiet()
    with ExitStack() as stack:

        def start() -> Any:
            if workers is None:
                return stack.enter_context(_client(Client, address))
            local = LocalCluster(
                workers, threads_per_worker=1, processes=True, memory_limit=memory, host="127.0.0.1",
                dashboard_address="127.0.0.1:0", scheduler_kwargs={"dashboard": False},
            )  # fmt: skip
            return stack.enter_context(Client(stack.enter_context(local), set_as_default=False))

        yield Cluster(start)


def _client(kind: Any, address: str | None) -> Any:
    """A client of the scheduler at an address, once it has a worker."""
    try:
        client = kind(address, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise DeglintError(
            f"cannot reach a scheduler at {address}. Start one with `dask scheduler`, and name it as tcp://HOST:PORT."
        ) from error
    try:
        client.wait_for_workers(1, timeout=_CONNECT)
    except TimeoutError as error:
        client.close()
        raise DeglintError(f"the cluster at {address} has no worker. Start some with `dask worker`.") from error
    return client


@contextmanager
def _scheduler() -> Iterator[None]:
    """Asking the scheduler, which may be gone."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        raise DeglintError(_LOST) from error


@lru_cache(maxsize=2)
def _unpacked(packed: bytes) -> Callable[[Tile], Any]:
    """The work that bytes hold, unpacked once in each worker process."""
    import cloudpickle
    import cv2
    from threadpoolctl import threadpool_limits

    cv2.setNumThreads(1)  # the worker's threads are all the threads
    threadpool_limits(1, user_api="blas")
    work: Callable[[Tile], Any] = cloudpickle.loads(packed)  # from the scheduler, never from a disk
    return work


def _do(packed: bytes, tile: Tile) -> Any:
    """Do the work on a tile; a refusal goes back without its cause, which may not travel."""
    with environment():
        try:
            return _unpacked(packed)(tile)
        except DeglintError as error:
            refusal = type(error)(str(error))
    raise refusal


@dataclass(frozen=True, eq=False)
class _ToFiles:
    """Work whose images are left as parts in files; `layouts` says what images they are parts of, by field."""

    work: Callable[[Tile], Any]
    folder: Path
    layouts: Mapping[str, Layout]

    def __call__(self, tile: Tile) -> Any:
        done = self.work(tile)
        kept: dict[str, Any] = {}
        for name, layout in self.layouts.items():
            if (array := getattr(done, name)) is not None:
                valid = done.valid if layout.masked else None
                kept[name] = self._write(f"{tile.row0}-{tile.col0}-{name}.npy", array, valid)
        if hasattr(done, "valid"):
            kept["valid"] = None  # it is in the part
        return replace(done, **kept)

    def _write(self, name: str, array: Any, valid: Any) -> Path:
        """All of it or nothing: a worker may be ended at any time, and another be doing the same tile."""
        if not self.folder.is_dir():
            raise WriteError(
                f"a worker on {socket.gethostname()} does not see {self.folder.parent}. Workers need the output's "
                "directory, under the same name."
            )
        scratch, path = self.folder / f"{secrets.token_hex(4)}-{name}", self.folder / name
        write_part(scratch, array, valid)
        try:
            scratch.replace(path)
        except OSError as error:
            raise WriteError(f"cannot write in {self.folder.parent}: {error.strerror or error}.") from error
        return path


def _remove(folder: Path) -> None:
    """Remove a directory, in which workers that have not heard of the end may still be writing."""
    for _ in range(50):
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            return
        time.sleep(0.1)


def _umask() -> int:
    """The permissions that this process withholds from new files."""
    umask = os.umask(0)
    os.umask(umask)
    return umask


def _peak() -> int:
    """Most memory that this process has held [byte]; 0 where the system does not tell."""
    try:
        status = Path("/proc/self/status").read_text()  # ru_maxrss would be that of the parent, where it was larger
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM:")), 0)


def _quiet() -> None:
    """The workers' comings and goings are no news: what matters becomes an error."""
    for name in ("distributed", "distributed.nanny", "distributed.scheduler", "distributed.worker"):
        logging.getLogger(name).setLevel(logging.ERROR)
    for name in ("distributed.client", "distributed.utils"):  # tracebacks of what is told in one line
        logging.getLogger(name).setLevel(logging.CRITICAL)
