"""Many scenes with one recipe: those that are not finished are worked on, and one that fails does not stop the rest.

What is finished is known by recipe and checksums, so a batch that was stopped - however - goes on where it was.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from ..errors import InputError, WriteError
from ..raster.scratch import MOVED, claimed
from ..raster.targets import check_target
from ..readers.scenes import ListedScene
from .jobs import DONE, FAILED, TODO, Job, Outcome, Say, jobs_of, outcome, state_of
from .order import Order
from .workers import run_jobs


def run_batch(
    order: Order, scenes: Sequence[ListedScene], *, processes: int = 1, threads: int | None = None,
    overwrite: bool = False, dry_run: bool = False, say: Say | None = None, reads: Sequence[str] = (),
) -> list[Outcome]:  # fmt: skip
    """Take the glint off many scenes.

    Parameters
    ----------
    order : Order
    scenes : sequence of ListedScene
        From `deglint.readers.scenes.list_scenes`.
    processes : int
        Scenes that are worked on at the same time, each in a process of its own: what ends one ends no other.
    threads : int, optional
        Of each process; all processors, shared out, by default.
    overwrite : bool
        Make again what was made by another recipe or of another input; what is finished is never made again.
    dry_run : bool
        Only say what would be done.
    say : callable, optional
        Told what happens.
    reads : sequence of str
        Files that were read for this batch, such as its recipe and its lists: no output may replace them.

    Returns
    -------
    list of Outcome
        One a scene, in their order.

    Raises
    ------
    InputError, WriteError
        Names that clash, a directory that cannot be written to, or another batch at work in it: nothing was begun.
    """
    if processes < 1:
        raise InputError(f"jobs: want at least 1, got {processes}.")
    jobs, request = jobs_of(order, scenes, reads), order.request()
    found: dict[int, Outcome] = {}
    todo: dict[int, tuple[Job, bool]] = {}

    def tell(what: str, about: Any) -> None:
        if what == "end" and about.status == DONE:
            MOVED.append(Path(about.output))  # by a worker; an interruption says so
        if say is not None:
            say(what, about)

    with nullcontext() if dry_run else _claimed(order.directory):
        for i, job in enumerate(jobs):
            begun = time.perf_counter()
            status, why = state_of(job, request)
            if status == FAILED:
                status, why = (TODO, why) if overwrite else (FAILED, f"{why}. Give --overwrite to make it again")
            if status == TODO and not dry_run:
                todo[i] = job, overwrite or bool(why)
                continue
            found[i] = outcome(job, status, why, time.perf_counter() - begun)
            tell("end", found[i])
        found |= run_jobs(todo, order, request, processes, threads, tell)
    return [found[i] for i in range(len(jobs))]


@contextmanager
def _claimed(directory: Path) -> Iterator[None]:
    """Make the directory of the outputs, and keep other batches from it."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WriteError(f"the directory {directory} cannot be made: {error.strerror}. Choose another.") from error
    check_target(directory / "x.tif", overwrite=True)
    with claimed(directory):
        yield
