"""Run a batch in separate processes: a scene that fails, or crashes its process, does not stop the others.

Finished scenes are recognised by recipe and checksums, so a batch that was interrupted can be continued. A worker keeps
its loaded modules from scene to scene. A worker that crashes is reported with its exit code and replaced. When the
batch is stopped, its workers remove temporary files and end.
"""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from logging.handlers import QueueHandler
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

from ..errors import DeglintError, InputError, NoWaterError
from ..pipeline.run import remove_glint
from ..raster.scratch import MOVED, claimed, make_directory
from ..raster.targets import check_target
from ..readers.scenes import ListedScene
from ..tiles import default_threads
from .jobs import DONE, FAILED, NO_WATER, TODO, Job, Order, Outcome, jobs_of, state_of

log = logging.getLogger(__name__)
STOP_PATIENCE = 10.0
"""Time that workers have to remove temporary files when the batch is stopped [s]."""


def run_batch(
    order: Order, scenes: Sequence[ListedScene], *, processes: int = 1, threads: int | None = None,
    overwrite: bool = False, dry_run: bool = False, done: Callable[[Outcome], None] | None = None,
) -> list[Outcome]:  # fmt: skip
    """Remove glint from many scenes and return the outcome of each, in their order.

    `processes` scenes are processed at the same time, each with `threads` threads (by default the processors are
    divided evenly). `overwrite` recomputes outputs of another recipe or of another input; finished scenes are never
    recomputed. `dry_run` only reports what would be done. `done` is called with the outcome of each scene at its end.

    Raises InputError, WriteError before any work starts: names that clash, a directory that cannot be written to, or
    another batch that runs in it.
    """
    if processes < 1:
        raise InputError(f"jobs: want at least 1, got {processes}.")
    jobs = jobs_of(order, scenes)
    found: dict[int, Outcome] = {}
    todo: dict[int, Job] = {}

    def ended(number: int, outcome: Outcome) -> None:
        found[number] = outcome
        if outcome.status == DONE:
            MOVED.append(Path(outcome.output))  # by a worker; an interruption says so
        if done is not None:
            done(outcome)

    with contextlib.ExitStack() as stack:
        if not dry_run:  # lock the directory against other batches
            make_directory(order.directory, parents=True)
            check_target(order.directory / "x.tif", overwrite=True)
            stack.enter_context(claimed(order.directory))
        for i, job in enumerate(jobs):
            begun = time.perf_counter()
            status, why = state_of(job)
            if status == FAILED:
                status, why = (TODO, why) if overwrite else (FAILED, f"{why}. Give --overwrite to make it again")
            if status == TODO and not dry_run:
                todo[i] = replace(job, outputs=replace(job.outputs, overwrite=overwrite or bool(why)))
            else:
                ended(i, job.ended(status, why, begun=begun))
        count = min(processes, len(todo))
        _run_jobs(todo, order, count, threads or max(1, default_threads() // max(count, 1)), ended)
    return [found[i] for i in range(len(jobs))]


def _run_jobs(
    todo: Mapping[int, Job], order: Order, count: int, threads: int, ended: Callable[[int, Outcome], None]
) -> None:
    """Run the jobs on `count` processes of some threads each; `ended` is called with the number of each job."""
    waiting = list(todo)[::-1]
    idle: dict[Any, Any] = {}  # processes, by the way to talk to them
    busy: dict[Any, tuple[Any, int, float]] = {}  # the same, with the job that each has and when it began
    try:
        while waiting or busy:
            while waiting and len(busy) < count:
                line, process = idle.popitem() if idle else _start(order, threads)
                number = waiting.pop()
                busy[line] = process, number, time.perf_counter()
                with contextlib.suppress(OSError):  # it died: its line says so below
                    line.send(todo[number])
            for line in wait(list(busy)):
                process, number, begun = busy[line]
                outcome = _hear(line, process, todo[number], begun)
                if outcome is not None:
                    ended(number, outcome)
                    del busy[line]
                    if process.is_alive():
                        idle[line] = process
    finally:
        for line in idle:
            with contextlib.suppress(OSError):
                line.send(None)
        at_work = [process for process, _number, _begun in busy.values()]
        for process in at_work:
            process.terminate()
        _join([*idle.values(), *at_work])


def _start(order: Order, threads: int) -> tuple[Any, Any]:
    """Start a worker; return the connection to it, and its process."""
    context = get_context("spawn")  # a fork would take locks of this process's threads with it
    ours, theirs = context.Pipe()
    talks = log.isEnabledFor(logging.DEBUG)
    process = context.Process(target=_serve, args=(theirs, order, threads, talks), daemon=False)
    process.start()
    theirs.close()
    return ours, process


def _hear(line: Any, process: Any, job: Job, begun: float) -> Outcome | None:
    """Read one message of a worker; return the outcome of its job, or None if the job still runs."""
    try:
        said = line.recv()
    except (EOFError, OSError):
        process.join()
        code = process.exitcode
        why = f"its process ended with exit code {code}"
        if code < 0:
            why = f"its process was ended by signal {-code} ({signal.Signals(-code).name})"
        if code == -signal.SIGKILL:
            why += ": out of memory, perhaps; try fewer --jobs"
        return job.ended(FAILED, why, begun=begun)
    if isinstance(said, Outcome):
        return said
    log.log(said.levelno, "%s: %s", job.scene.name, said.getMessage())
    return None


def _join(processes: Iterable[Any]) -> None:
    """Wait until workers have ended; kill those that do not end in time."""
    until = time.monotonic() + STOP_PATIENCE
    for process in processes:
        process.join(max(until - time.monotonic(), 0.1))
        if process.is_alive():
            process.kill()
            process.join()


class _Forward(QueueHandler):
    """Log handler of a worker: sends its records to the batch process."""

    def enqueue(self, record: logging.LogRecord) -> None:
        with contextlib.suppress(OSError):
            self.queue.send(record)  # type: ignore[attr-defined]


def _serve(line: Any, order: Order, threads: int, talks: bool) -> None:
    """Main loop of a worker: run jobs until there are no more or the batch process has ended.

    It sends all its log records if it `talks`, else only those of the remaining time.
    """
    sent = logging.getLogger("deglint" if talks else "deglint.timing")
    sent.setLevel(logging.INFO)
    sent.addHandler(_Forward(line))
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)  # as Ctrl-C does
    threading.Thread(target=_watch_parent, daemon=True).start()
    with contextlib.suppress(KeyboardInterrupt, EOFError, OSError):
        while (job := line.recv()) is not None:
            line.send(_do(job, order, threads))


def _watch_parent() -> None:
    if (parent := parent_process()) is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)


def _do(job: Job, order: Order, threads: int) -> Outcome:
    begun = time.perf_counter()
    try:
        result = remove_glint(job.scene.source, job.outputs, order.recipe, **order.opening(), threads=threads)
    except NoWaterError as error:
        return job.ended(NO_WATER, str(error), begun=begun)
    except Exception as error:  # noqa: BLE001  (one bad scene does not stop the rest)
        return job.ended(FAILED, _reason(error), begun=begun)
    tally, method = result.tally, result.fitted.model.method
    share = tally.corrected / max(tally.total, 1)
    return job.ended(DONE, begun=begun, method=method, corrected=share, warnings=len(result.warnings))


def _reason(error: Exception) -> str:
    """Why a scene failed, in one line."""
    if isinstance(error, MemoryError):
        return "out of memory. Use fewer --jobs, or a machine with more."
    line = " ".join(str(error).split())
    return line if isinstance(error, DeglintError) else f"{type(error).__name__}: {line} (a fault of deglint's own)"
