"""Pass over a scene's tiles on the workers of a dask cluster: processes of this machine, or other machines.

A `Cluster` does what `deglint.tiles.run` does on threads. Every worker opens the input for itself; results come back to
the calling process, which writes them. Other workers repeat the tiles of a worker that dies, with the same result.
"""

from __future__ import annotations

import logging
import re
import secrets
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any

from ..errors import DeglintError, InputError
from ..raster.environment import environment
from ..tiles import Tile

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
        progress: Callable[[int, int], None] | None = None, **_of_threads: Any,
    ) -> Iterator[tuple[Tile, Any]]:  # fmt: skip
        """Do work on every tile and yield (tile, result) in order, as `deglint.tiles.run` does.

        Its options of threads are not used: threads are those of the workers, and each task enters GDAL's environment
        by itself.

        Raises DeglintError: what the work itself raised; or there are no workers any more, or too little memory.
        """
        import cloudpickle

        shipped = self.client.submit(bytes, cloudpickle.dumps(work), key=f"deglint-work-{secrets.token_hex(8)}")
        todo, waiting, most = iter(everything), deque[tuple[Tile, Any]](), 0
        try:
            for done in range(len(everything)):
                if done % _RECOUNT == 0:
                    with _answering():
                        most = TILES_AHEAD * max(sum(self.client.nthreads().values()), 1)
                while len(waiting) < most and (tile := next(todo, None)) is not None:
                    waiting.append((tile, self.client.submit(_do, shipped, tile, pure=False)))
                tile, future = waiting.popleft()
                yield tile, self._result(future)
                del future
                if progress:
                    progress(done + 1, len(everything))
        finally:
            self.client.cancel([future for _tile, future in waiting])

    def _result(self, future: Any) -> Any:
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError

        without = time.monotonic()
        while True:
            try:
                with suppress(TimeoutError):
                    return future.result(timeout=_POLL)
                if future.done():  # just now; or the work itself has run out of time
                    return future.result()
                if self.client.nthreads():
                    without = time.monotonic()
            except DeglintError:
                raise
            except KilledWorker as error:
                raise DeglintError(_KILLED) from error
            except (FutureCancelledError, OSError) as error:
                raise DeglintError(_LOST) from error
            if time.monotonic() - without > WORKER_PATIENCE:
                raise DeglintError(_NO_WORKER)

    def memory(self) -> dict[str, int]:
        """Most memory that each worker process has held so far [byte]; empty where none was needed."""
        with _answering():
            return dict(self.client.run(_peak)) if "client" in vars(self) else {}

    def numbers(self) -> dict[str, Any]:
        """What the sidecar says of the workers: how many there are, and the most memory that one has held so far."""
        held = self.memory().values()
        return {"workers": len(held), "most_memory_of_one_MB": round(max(held, default=0) / 1e6, 1)}


@contextmanager
def connect(address: str | None = None, *, workers: int | None = None, memory: str = "auto") -> Iterator[Cluster]:
    """Connect to a cluster, or start one of this machine's processes for as long as it is needed.

    Parameters
    ----------
    address : str, optional
        Of a dask scheduler, such as "tcp://10.0.0.5:8786". Workers must have deglint, and see the input under
        the same name.
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
        import distributed  # noqa: F401
    except ModuleNotFoundError as error:
        raise DeglintError(
            "a cluster needs dask's distributed. Install it with: pip install 'deglint[cluster]'"
        ) from error
    if address is not None and not re.fullmatch(r"\w+://\S+:\d+", address):
        raise InputError(f"the address of a cluster looks like tcp://HOST:PORT, got {address!r}.")
    _quiet()
    with ExitStack() as stack:
        yield Cluster(partial(_client, stack, address, workers, memory))


def _client(stack: ExitStack, address: str | None, workers: int | None, memory: str) -> Any:
    """A client of a cluster, or of processes that are started here, for as long as the stack lives."""
    from distributed import Client, LocalCluster

    if workers is not None:
        local = LocalCluster(
            workers, threads_per_worker=1, processes=True, memory_limit=memory, host="127.0.0.1",
            dashboard_address="127.0.0.1:0", scheduler_kwargs={"dashboard": False},
        )  # fmt: skip
        inside = stack.enter_context(local)
        return stack.enter_context(Client(inside, set_as_default=False, direct_to_workers=True))
    try:
        client = stack.enter_context(Client(address, timeout=_CONNECT, set_as_default=False))
    except (OSError, ValueError, TypeError) as error:
        raise DeglintError(
            f"cannot reach a scheduler at {address}. Start one with `dask scheduler`, and name it as tcp://HOST:PORT."
        ) from error
    try:
        client.wait_for_workers(1, timeout=_CONNECT)
    except TimeoutError as error:
        raise DeglintError(f"the cluster at {address} has no worker. Start some with `dask worker`.") from error
    return client


@contextmanager
def _answering() -> Iterator[None]:
    """One line where the scheduler does not answer."""
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
    for name in ("distributed.client", "distributed.utils"):  # tracebacks of what one line says
        logging.getLogger(name).setLevel(logging.CRITICAL)
