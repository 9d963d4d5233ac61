"""Process many scenes with one recipe, in separate processes: a scene that fails does not stop the others.

A recipe file holds the options. A scene is finished if its sidecar (the JSON file beside the output) records the same
options, and its input and outputs have not changed since. An interrupted batch can therefore be continued. Each worker
process handles one scene after the other, so it imports modules only once. A crashed worker is reported and replaced.
"""

import contextlib
import hashlib
import json
import logging
import os
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field, fields, replace
from logging.handlers import QueueHandler
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from .checks import check_choice, check_kind
from .checksum import are_as, fingerprint, is_as
from .errors import DeglintError, InputError, NoWaterError
from .pipeline import Outputs
from .pipeline.outputs import BESIDE
from .pipeline.recipe import Recipe, band_names
from .pipeline.run import READING, remove_glint
from .raster.environment import environment
from .raster.output import DTYPES
from .raster.targets import check_target, check_unread, claimed, files_behind, make_directory
from .readers.scenes import ListedScene, checked_name, files_of
from .readers.text import read_json, read_toml
from .tiles import default_threads

log = logging.getLogger(__name__)
# status of a scene
TODO, DONE, FINISHED, NO_WATER, FAILED = "to do", "done", "finished before", "no water", "failed"
STOP_PATIENCE = 10.0  # time that a worker has to remove temporary files after the batch is stopped [s]


@dataclass(frozen=True)
class BatchConfig:
    """Options that apply to every scene of a batch: the tables [recipe], [output] and [input] of a recipe file."""

    recipe: Recipe = field(default_factory=Recipe)
    directory: Path = Path()  # of the outputs; created if it is missing
    name: str = "{name}_deglinted.tif"  # file name of an image; "{name}" stands for the name of the scene
    extras: tuple[str, ...] = ()  # keys of `BESIDE`: further outputs, such as X_flags.tif beside an image X.tif
    dtype: str | None = None  # type of the image; None: the type of the scene
    options: Mapping[str, str] = field(default_factory=dict)  # GDAL creation options
    opening: Mapping[str, Any] = field(default_factory=dict)  # keywords of `deglint.open_scene`
    assets: tuple[str, ...] = ()  # names of the assets of a STAC Item that are its bands
    reads: tuple[str, ...] = ()  # further input files, such as the recipe, which no output may replace

    def request(self) -> str:
        """SHA-256 (hexadecimal) of the mask, sample and sensor files and all options except `directory` and `reads`."""
        read = files_behind([self.recipe.sample, self.recipe.mask, str(self.opening.get("sensor"))])
        files = {path: fingerprint(path)["crc32"] for path in read}
        said = asdict(replace(self, directory=Path(), reads=())) | {"files": files}
        return hashlib.sha256(json.dumps(said, sort_keys=True, default=str).encode()).hexdigest()


def read_config(path: str, directory: str | None = None) -> BatchConfig:
    """Read a recipe file, TOML with the tables of `BatchConfig`; `directory`, if given, replaces that of the file.

    Raises ReadError if the file cannot be read, and InputError if it is not TOML, or if a name or value in it is not
    allowed. The output directory in the file must not lead out of the current directory by ".."; `directory` may do so.
    """
    document = read_toml(path, "recipe")
    of_output = ["directory", "name", "extras", "dtype", "options"]
    allowed = {"recipe": [f.name for f in fields(Recipe)], "input": [*READING, "assets"], "output": of_output}
    for table, values in document.items():
        if table not in allowed or not isinstance(values, dict):
            raise InputError(f"{path}: {table!r} is not one of the tables [recipe], [input], [output].")
        if unknown := [name for name in values if name not in allowed[table]]:
            raise InputError(f"{path}: [{table}] {unknown[0]} is not one of {', '.join(sorted(allowed[table]))}.")
    recipe, output, opening = (dict(document.get(table, {})) for table in ("recipe", "output", "input"))
    try:
        for name in ("directory", "name", "dtype"):
            check_kind(output.get(name, ""), str, f"[output] {name}", "Write it in quotes.")
        place, options = output.pop("directory", ""), output.pop("options", {})
        check_kind(options, dict, "[output] options", "Write NAME = VALUE pairs, as {COMPRESS = 'ZSTD'}.")
        batch = BatchConfig(
            Recipe(**recipe),
            Path(directory or place),
            extras=band_names(output.pop("extras", ()), "extras"),
            options={k: {True: "YES", False: "NO"}[v] if isinstance(v, bool) else str(v) for k, v in options.items()},
            assets=band_names(opening.pop("assets", ()), "assets"),
            opening=opening,
            **output,
        )
        if "{name}" not in batch.name or Path(batch.name).suffix.lower() not in (".tif", ".tiff"):
            raise InputError(f"[output] name {batch.name!r} must hold {{name}} and end in .tif, as {{name}}_clean.tif.")
        checked_name(batch.name.replace("{name}", "x"), "[output] name")
        for extra in batch.extras:
            check_choice(extra, list(BESIDE), "[output] extras:")
        check_choice(batch.dtype or "float32", list(DTYPES), "[output] dtype")
        if directory is None and Path(os.path.normpath(batch.directory)).parts[:1] == (os.pardir,):
            raise InputError(
                f"[output] directory {str(batch.directory)!r} is outside the current directory. To allow this, "
                "give the directory on the command line: --directory DIR."
            )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return batch


@dataclass(frozen=True)
class Outcome:
    """Result of one scene, which is a row of the summary of the batch."""

    name: str  # name of the scene
    inputs: str  # paths of the scene, separated by ";"
    output: str  # path of the image
    status: str  # "done", "finished before", "to do", "no water" or "failed"
    reason: str = ""  # why it failed, has no water, or is to be done again
    seconds: float = 0.0  # duration [s]
    method: str = ""  # method of removal
    corrected: float | None = None  # share of the pixels that were corrected [1]
    warnings: int = 0  # number of warnings in the sidecar


@dataclass(frozen=True)
class BatchJob:
    """One scene of a batch, and the outputs that are made from it."""

    scene: ListedScene
    outputs: Outputs

    def ended(self, status: str, reason: str = "", **more: Any) -> Outcome:
        """Make the `Outcome` of this scene from its status, the reason for it, and further fields (`more`)."""
        return Outcome(self.scene.name, ";".join(self.scene.paths), str(self.outputs.image), status, reason, **more)


def jobs_of(config: BatchConfig, scenes: Sequence[ListedScene]) -> list[BatchJob]:
    """One job for each scene; raise InputError if scenes have the same output or an output would replace an input."""
    jobs = []
    made: dict[str, Any] = {"dtype": config.dtype, "options": config.options, "request": config.request()}
    for scene in scenes:
        image = config.directory / config.name.replace("{name}", scene.name)
        extras: Any = {name: image.with_name(f"{image.stem}_{name}.{BESIDE[name]}") for name in config.extras}
        jobs.append(BatchJob(scene, Outputs(image, **made, **extras)))
    names = Counter(path for job in jobs for path in job.outputs.every())
    if twice := next((path for path, count in names.items() if count > 1), None):
        them = ", ".join(job.scene.paths[0] for job in jobs if twice in job.outputs.every())
        raise InputError(
            f"several scenes would be written to {twice}: {them[:300]}. Give them names of their own, in a CSV "
            "with columns path and name."
        )
    # an output that does not exist yet cannot be an input file
    if there := [path for job in jobs for path in job.outputs.every() if path.exists()]:
        scenes_files = [p for job in jobs for name in job.scene.source for p in (name, *files_of(name))]
        named = [config.recipe.sample, config.recipe.mask, str(config.opening.get("sensor")), *config.reads]
        with environment():
            check_unread(there, {"a scene": scenes_files, "an input": named})
    return jobs


def state_of(job: BatchJob) -> tuple[str, str]:
    """Return status "to do", "finished before" or "failed" (existing outputs do not fit the job), and the reason."""
    image, sidecar, every = job.outputs.image, job.outputs.sidecar, job.outputs.every()
    if not (there := [p for p in every if p.exists()]):
        return TODO, ""
    try:
        batch = read_json(str(sidecar), "sidecar")["batch"]
        request, inputs = batch["request"], {i["path"]: i for i in batch["inputs"]}
        outputs = {p: batch["outputs"].get(p.name, {}) for p in there if p != sidecar}
    except (DeglintError, AttributeError, KeyError, TypeError):
        return FAILED, f"{there[0]} exists and was not made by this batch"
    if request != job.outputs.request:
        return FAILED, f"{image} was made by another recipe"
    with environment():
        if not are_as([p for name in job.scene.source for p in files_of(name)], inputs):
            return FAILED, f"the scene was changed after {image} was made"
    if changed := [path for path, said in outputs.items() if not is_as(path, said)]:
        return FAILED, f"{changed[0]} was changed after it was made"
    if len(there) < len(every):
        return TODO, "the last run was stopped before all outputs were in place"
    return FINISHED, ""


def run_batch(
    config: BatchConfig,
    scenes: Sequence[ListedScene],
    *,
    processes: int = 1,
    threads: int | None = None,
    overwrite: bool = False,
    dry_run: bool = False,
    done: Callable[[Outcome], None] | None = None,
) -> list[Outcome]:
    """Remove glint from many scenes and return the outcome of each, in the order of `scenes`.

    `processes` scenes are processed at the same time, each with `threads` threads (by default the processors are
    divided evenly). `overwrite` replaces existing outputs that were altered, or do not come from this recipe and
    these inputs; finished scenes are never recomputed. `dry_run` only reports what would be done. `done` is called with
    each outcome. Before any scene is processed, the function raises InputError if an output would replace another
    output or an input; and WriteError, except in a dry run, if another batch uses the directory or it is not writable.
    """
    jobs = jobs_of(config, scenes)
    found: dict[int, Outcome] = {}
    todo: dict[int, BatchJob] = {}

    def ended(number: int, outcome: Outcome) -> None:
        found[number] = outcome
        if done:
            done(outcome)

    with contextlib.ExitStack() as stack:
        if not dry_run:  # lock the directory against other batches
            make_directory(config.directory, parents=True)
            check_target(config.directory / "x.tif", overwrite=True)
            stack.enter_context(claimed(config.directory))
        for i, job in enumerate(jobs):
            status, why = state_of(job)
            if status == FAILED:
                status, why = (TODO, why) if overwrite else (FAILED, f"{why}. Give --overwrite to make it again")
            if status == TODO and not dry_run:
                todo[i] = replace(job, outputs=replace(job.outputs, overwrite=overwrite or bool(why)))
            else:
                ended(i, job.ended(status, why))
        if todo:
            count = min(processes, len(todo))
            _run_jobs(todo, config, count, threads or max(1, default_threads() // count), ended)
    return [found[i] for i in range(len(jobs))]


def _run_jobs(
    todo: Mapping[int, BatchJob], config: BatchConfig, count: int, threads: int, ended: Callable[[int, Outcome], None]
) -> None:
    """Run jobs on `count` processes of `threads` threads; call `ended` with the key (in `todo`) and outcome of each."""
    workers = [_Worker(config, threads) for _ in range(count)]
    idle = deque(workers)

    def work(job: BatchJob) -> Outcome:
        worker = idle.popleft()  # never empty: there are as many workers as threads of the pool
        done = worker.run(job)
        idle.append(worker)
        return done

    pool = ThreadPoolExecutor(count)
    try:
        running = {pool.submit(work, job): number for number, job in todo.items()}
        for future in as_completed(running):
            ended(running[future], future.result())
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for worker in workers:
            worker.process.terminate()
        for worker in workers:
            worker.process.join(STOP_PATIENCE)
            worker.process.kill()


class _Worker:
    """A worker process that runs one job after the other; if it has crashed, the next job starts a new process."""

    def __init__(self, config: BatchConfig, threads: int) -> None:
        self._config, self._threads = config, threads
        self.start()

    def start(self) -> None:
        """Start the worker process, and a pipe to send jobs to it."""
        context = get_context("spawn")  # a fork would take locks of this process's threads with it
        self._line, theirs = context.Pipe()
        talks = log.isEnabledFor(logging.DEBUG)
        self.process = context.Process(target=_serve, args=(theirs, self._config, self._threads, talks))
        self.process.start()
        theirs.close()

    def run(self, job: BatchJob) -> Outcome:
        """Run a job in the worker process and return its outcome, "failed" after a crash; log the worker's messages."""
        begun = time.perf_counter()
        if not self.process.is_alive():
            self.start()
        try:
            self._line.send(job)
            while not isinstance(said := self._line.recv(), Outcome):
                log.log(said.levelno, "%s: %s", job.scene.name, said.getMessage())
            return said
        except (EOFError, OSError):
            self.process.join()
        code, seconds = self.process.exitcode, round(time.perf_counter() - begun, 3)
        why = " (SIGKILL): out of memory, perhaps; try fewer --jobs" if code == -9 else ""
        return job.ended(FAILED, f"its process ended with exit code {code}{why}", seconds=seconds)


def _serve(line: Connection, config: BatchConfig, threads: int, talks: bool) -> None:
    """Main loop of a worker process: run jobs until the batch process stops the worker, or has ended.
    `line` is a pipe from which jobs are read, and to which outcomes and log records are sent. If `talks` is False, the
    only log records that are sent are those on the remaining time.
    """
    sent = logging.getLogger("deglint" if talks else "deglint.timing")
    sent.setLevel(logging.INFO)
    sent.addHandler(QueueHandler(SimpleNamespace(put_nowait=line.send)))
    logging.raiseExceptions = False  # no traceback if the batch process has ended
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C does
    threading.Thread(target=_watch_parent, daemon=True).start()
    with contextlib.suppress(KeyboardInterrupt, EOFError, OSError):
        while True:
            job, begun = line.recv(), time.perf_counter()
            line.send(replace(_do(job, config, threads), seconds=round(time.perf_counter() - begun, 3)))


def _watch_parent() -> None:
    if (parent := parent_process()) is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)


def _do(job: BatchJob, config: BatchConfig, threads: int) -> Outcome:
    try:
        result = remove_glint(job.scene.source, job.outputs, config.recipe, **config.opening, threads=threads)
    except NoWaterError as error:
        return job.ended(NO_WATER, str(error))
    except MemoryError:
        return job.ended(FAILED, "out of memory. Use fewer --jobs, or a machine with more.")
    except Exception as error:  # noqa: BLE001  (one bad scene does not stop the rest)
        fault = "" if isinstance(error, DeglintError) else f" ({type(error).__name__}, a bug in deglint)"
        return job.ended(FAILED, " ".join(str(error).split()) + fault)
    share, method = result.counts.corrected / result.counts.total, result.fitted.model.method
    return job.ended(DONE, method=method, corrected=share, warnings=len(result.warnings))
