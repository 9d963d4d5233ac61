"""Process a scene's tiles on the workers of a Dask cluster: processes of this machine, or other machines.

`Cluster.run` replaces `deglint.tiles.run`, which uses threads. Every worker opens the input itself; results are sent to
the calling process, which writes them. If a worker crashes, other workers repeat its tiles, with the same result.
"""

import logging
import re
import secrets
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

from .errors import DeglintError, InputError
from .tiles import T, Tile, one_thread_each

TILES_AHEAD = 3  # most tiles in progress, or finished and not fetched yet, for each thread of a worker
WORKER_PATIENCE = 60.0  # time without a result after which to check that the cluster has workers [s]
_CONNECT = 15.0  # time limit of a connection to the scheduler, and of the wait for a worker [s]
_LOST = "lost the cluster: its scheduler does not answer. Start the scheduler, and run the command again."


@dataclass(frozen=True, eq=False)
class Cluster:
    """A connection to a Dask cluster whose workers process tiles; it is made by `connect`."""

    client: Any  # the `distributed.Client`

    def run(
        self,
        everything: Sequence[Tile],
        work: Callable[[Tile], T],
        *,
        progress: Callable[[int, int], None] | None = None,
        **_of_threads: object,
    ) -> Iterator[tuple[Tile, T]]:
        """Call `work` on every tile and yield (tile, result) in order, like `tiles.run`, whose `threads` is ignored.

        Raises errors of `work`; DeglintError if the scheduler or all workers are lost, or a tile kills several workers.
        """
        import cloudpickle

        with _answering():
            shipped = self.client.submit(bytes, cloudpickle.dumps(work), key=f"deglint-work-{secrets.token_hex(8)}")
        todo, waiting = iter(everything), deque[tuple[Tile, Any]]()
        try:
            for done in range(len(everything)):
                with _answering():  # workers come and go
                    most = TILES_AHEAD * max(sum(self.client.nthreads().values()), 1)
                for tile in islice(todo, max(most - len(waiting), 0)):
                    waiting.append((tile, self.client.submit(_do, shipped, tile, pure=False)))
                tile, future = waiting.popleft()
                yield tile, self._result(future)
                del future
                if progress:
                    progress(done + 1, len(everything))
        finally:
            self.client.cancel([future for _tile, future in waiting])

    def _result(self, future: Any) -> Any:
        """Wait for a task (a Dask future) and return its result; an error of the cluster is raised as DeglintError."""
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError

        try:
            while True:
                with suppress(TimeoutError):
                    return future.result(timeout=WORKER_PATIENCE)
                if future.done():  # it ended just now, or `work` itself raised TimeoutError
                    return future.result()
                if not self.client.nthreads():
                    raise DeglintError("the cluster has no worker. Start `dask worker`, or give each more memory.")
        except DeglintError:  # ReadError and WriteError are OSErrors, but no loss of the cluster
            raise
        except KilledWorker as error:
            said = "several workers ended on one tile, probably out of memory. Give each more memory or fewer threads."
            raise DeglintError(said) from error
        except (FutureCancelledError, OSError) as error:
            raise DeglintError(_LOST) from error

    def memory(self) -> dict[str, int]:
        """Peak memory of each worker process so far [byte]; keys are the addresses of the workers."""
        with _answering():
            return dict(self.client.run(_peak))

    def numbers(self) -> dict[str, float]:
        """Entries for the sidecar (a JSON file): number of workers, and the largest peak memory of a worker [MB]."""
        held = self.memory().values()
        return {"workers": len(held), "most_memory_of_one_MB": round(max(held, default=0) / 1e6, 1)}


def check_cluster(address: str | None, workers: int | None, memory: str) -> None:
    """Check arguments of `connect`, and raise InputError as `connect` does; nothing is connected or started."""
    if (address is None) == (workers is None) or (workers is not None and workers < 1):
        raise InputError("want the address of a cluster or a number of workers from 1, one of the two.")
    if not re.fullmatch(r"auto|\d+(\.\d+)? ?[kKMGT]i?B", memory):
        raise InputError(f"memory of a worker: want a number and its unit, such as 1GiB or 800MB, got {memory!r}.")
    if address is not None and not re.fullmatch(r"\w+://\S+:\d+", address):
        raise InputError(f"the address of a cluster looks like tcp://HOST:PORT, got {address!r}.")


@contextmanager
def connect(address: str | None = None, *, workers: int | None = None, memory: str = "auto") -> Iterator[Cluster]:
    """Connect to a cluster, or start a local one, and provide it as a `Cluster` in the `with` block.

    Parameters
    ----------
    address : str, optional
        Address of a Dask scheduler, such as "tcp://10.0.0.5:8786". Its workers need deglint, and the same input paths.
    workers : int, optional
        Number of local processes to start, with one thread each, instead of an address.
    memory : str
        Memory limit of each local process, such as "1GiB"; "auto" divides the machine's memory among them. A process
        above its limit is killed, and its tiles are repeated.

    Raises InputError if an argument is malformed, or not exactly one of `address` and `workers` is given; DeglintError
    if `distributed` is not installed, or no scheduler or worker is reached.

    Examples
    --------
    >>> with connect(workers=4) as cluster:  # doctest: +SKIP
    ...     remove_glint("scene.tif", "clean.tif", cluster=cluster)
    """
    check_cluster(address, workers, memory)
    try:
        from distributed import Client, LocalCluster
    except ModuleNotFoundError as error:
        raise DeglintError("a cluster needs distributed. Install it with: pip install 'deglint[cluster]'") from error
    for name in ("", ".nanny", ".scheduler", ".worker", ".client", ".utils"):  # failures are raised as errors
        logging.getLogger(f"distributed{name}").setLevel(logging.CRITICAL)
    with ExitStack() as stack:
        try:
            place: object = address
            if workers is not None:
                own: dict[str, object] = {"dashboard_address": "127.0.0.1:0", "scheduler_kwargs": {"dashboard": False}}
                if memory != "auto":  # given "auto", LocalCluster divides by processors
                    own["memory_limit"] = memory
                place = stack.enter_context(LocalCluster(n_workers=workers, threads_per_worker=1, **own))
            client = Client(place, timeout=_CONNECT, set_as_default=False, direct_to_workers=workers is not None)
            stack.enter_context(client).wait_for_workers(1, timeout=_CONNECT)
        except (OSError, RuntimeError, ValueError, TypeError) as error:
            if workers is not None:
                why = f"cannot start workers on this machine ({' '.join(str(error).split())})"
                raise DeglintError(f"{why}. Take fewer, or leave out --workers: threads do the work.") from error
            raise DeglintError(
                f"cannot reach a scheduler with workers at {address}. Start one with `dask scheduler`, workers with "
                "`dask worker`, and name it as tcp://HOST:PORT."
            ) from error
        yield Cluster(client)


@contextmanager
def _answering() -> Iterator[None]:
    """Context manager that raises DeglintError, with a one-line message, if the connection to the scheduler is lost."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        raise DeglintError(_LOST) from error


@lru_cache(maxsize=2)
def _unpacked(packed: bytes) -> Callable[[Tile], object]:
    """Unpickle the function that processes tiles; cached: once for each process."""
    import cloudpickle

    work: Callable[[Tile], object] = cloudpickle.loads(packed)  # from the scheduler, never from a disk
    return work


@one_thread_each()
def _do(packed: bytes, tile: Tile) -> object:
    """Process a tile in a worker by the pickled function `packed`; DeglintErrors are raised without their cause."""
    try:
        return _unpacked(packed)(tile)
    except DeglintError as error:
        refusal = type(error)(str(error))
    raise refusal


def _peak() -> int:
    """Peak memory of this process [byte]; 0 where the operating system does not provide it."""
    try:
        status = Path("/proc/self/status").read_text()  # ru_maxrss would include the peak of the parent process
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM:")), 0)
