"""Work on the scenes of a batch in processes of their own, so that a scene that ends its process ends no other.

A worker keeps what it has loaded from scene to scene. One that dies is told of by its exit code, and replaced. When the
batch is stopped, or dies itself, the workers clean up and end.
"""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..errors import DeglintError, NoWaterError
from ..pipeline.run import remove_glint
from ..tiles import default_threads
from .jobs import DONE, FAILED, NO_WATER, Job, Outcome, Say, outcome
from .order import Order

log = logging.getLogger(__name__)
STOP_PATIENCE = 10.0
"""How long a worker may take to clean up when it is stopped [s]."""
_REPORT_EVERY = 0.2
"""Least time between two words on progress [s]."""


@dataclass(eq=False)
class _Worker:
    """A process, the way to talk to it, and the job that it has."""

    process: Any
    line: Any
    number: int = -1
    begun: float = 0.0


def run_jobs(
    todo: Mapping[int, tuple[Job, bool]], order: Order, request: str, processes: int, threads: int | None, say: Say
) -> dict[int, Outcome]:
    """Do jobs, each given with whether it may replace what is there, and say what came of each."""
    from multiprocessing.connection import wait

    found: dict[int, Outcome] = {}
    waiting = list(todo)[::-1]
    workers: list[_Worker] = []
    count = min(processes, len(todo))
    each = threads or max(1, default_threads() // max(count, 1))
    try:
        while waiting or any(w.number >= 0 for w in workers):
            while waiting and len(workers) < count:
                workers.append(_start(order, request, each))
            for worker in workers:
                if worker.number < 0 and waiting:
                    worker.number, worker.begun = waiting.pop(), time.perf_counter()
                    job, again = todo[worker.number]
                    say("begin", job.scene.name)
                    with contextlib.suppress(OSError):  # it died: its line says so below
                        worker.line.send((job, again))
            for line in wait([w.line for w in workers if w.number >= 0]):
                worker = next(w for w in workers if w.line is line)
                done = _hear(worker, todo[worker.number][0], say)
                if done is not None:
                    found[worker.number] = done
                    say("end", done)
                    worker.number = -1
                    if not worker.process.is_alive():
                        workers.remove(worker)
    finally:
        _stop(workers)
    return found


def _start(order: Order, request: str, threads: int) -> _Worker:
    from multiprocessing import get_context

    context = get_context("spawn")  # a fork would take locks of this process's threads with it
    ours, theirs = context.Pipe()
    talks = log.isEnabledFor(logging.DEBUG)
    process = context.Process(target=_serve, args=(theirs, order, request, threads, talks), daemon=False)
    process.start()
    theirs.close()
    return _Worker(process, ours)


def _hear(worker: _Worker, job: Job, say: Say) -> Outcome | None:
    """What a worker says; the outcome of its job where that is known."""
    try:
        what, about = worker.line.recv()
    except (EOFError, OSError):
        worker.process.join()
        code = worker.process.exitcode
        why = f"its process ended with exit code {code}"
        if code < 0:
            why = f"its process was ended by signal {-code} ({signal.Signals(-code).name})"
        if code == -signal.SIGKILL:
            why += ": out of memory, perhaps; try fewer --jobs"
        return outcome(job, FAILED, why, time.perf_counter() - worker.begun)
    if what == "end":
        done: Outcome = about
        return done
    if what == "log":
        log.log(about[0], "%s: %s", job.scene.name, about[1])
    else:
        say(what, (job.scene.name, *about))
    return None


def _stop(workers: list[_Worker]) -> None:
    for worker in workers:
        if worker.number < 0:
            with contextlib.suppress(OSError):
                worker.line.send(None)
        else:
            worker.process.terminate()
    until = time.monotonic() + STOP_PATIENCE
    for worker in workers:
        worker.process.join(max(until - time.monotonic(), 0.1))
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join()
        worker.line.close()


class _Forward(logging.Handler):
    """Sends what a worker logs to the batch."""

    def __init__(self, line: Any) -> None:
        super().__init__(logging.INFO)
        self._line = line

    def emit(self, record: logging.LogRecord) -> None:
        with contextlib.suppress(OSError):
            self._line.send(("log", (record.levelno, record.getMessage())))


def _serve(line: Any, order: Order, request: str, threads: int, talks: bool) -> None:
    """A worker's life: take jobs until there are no more, or the batch is gone; it sends its log if it `talks`."""
    if talks:
        logging.getLogger("deglint").setLevel(logging.INFO)
        logging.getLogger("deglint").addHandler(_Forward(line))
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)  # as Ctrl-C does
    threading.Thread(target=_watch_parent, daemon=True).start()
    with contextlib.suppress(KeyboardInterrupt, EOFError, OSError):
        while (task := line.recv()) is not None:
            job, again = task
            line.send(("end", _do(job, again, order, request, threads, line)))


def _watch_parent() -> None:
    from multiprocessing import parent_process
    from multiprocessing.connection import wait

    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os.kill(os.getpid(), signal.SIGTERM)


def _do(job: Job, again: bool, order: Order, request: str, threads: int, line: Any) -> Outcome:
    begun = time.perf_counter()
    last = [0.0]

    def progress(stage: str, done: int, total: int) -> None:
        now = time.perf_counter()
        if now - last[0] > _REPORT_EVERY:
            last[0] = now
            line.send(("progress", (stage, done, total)))

    extras: dict[str, Any] = {name: getattr(job.outputs, name) for name in order.extras}
    if "model" in extras:
        extras["model_file"] = extras.pop("model")
    try:
        result = remove_glint(
            job.scene.source, job.outputs.image, order.recipe, **order.opening(), threads=threads, progress=progress,
            overwrite=again, dtype=order.dtype, options=order.options, request=request, **extras,
        )  # fmt: skip
    except NoWaterError as error:
        return outcome(job, NO_WATER, str(error), time.perf_counter() - begun)
    except Exception as error:  # noqa: BLE001  (one bad scene does not stop the rest)
        return outcome(job, FAILED, _reason(error), time.perf_counter() - begun)
    tally = result.tally
    return outcome(
        job, DONE, "", time.perf_counter() - begun, method=result.fitted.model.method,
        corrected=tally.corrected / max(tally.total, 1), warnings=len(result.warnings),
    )  # fmt: skip


def _reason(error: Exception) -> str:
    """Why a scene failed, in one line."""
    if isinstance(error, MemoryError):
        return "out of memory. Use fewer --jobs, or a machine with more."
    line = " ".join(str(error).split())
    return line if isinstance(error, DeglintError) else f"{type(error).__name__}: {line} (a fault of deglint's own)"
