"""The scenes of a batch: the names of their outputs, what was made of them before, and what came of them.

What was made before is known again by the recipe and by the checksums of input and outputs in the sidecar.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ..checksum import are_as, is_as
from ..errors import DeglintError, InputError
from ..pipeline import Outputs
from ..raster.environment import environment
from ..raster.targets import check_unread
from ..readers.scenes import ListedScene
from ..readers.stac import files_of
from ..readers.text import read_json
from .order import EXTRAS, Order

TODO, DONE, FINISHED, NO_WATER, FAILED = "to do", "done", "finished before", "no water", "failed"


@dataclass(frozen=True)
class Job:
    """One scene of a batch, and its outputs."""

    scene: ListedScene
    outputs: Outputs


@dataclass(frozen=True)
class Outcome:
    """What came of one scene: a row of the summary."""

    name: str
    inputs: str
    output: str
    status: str  # "done", "finished before", "to do", "no water" or "failed"
    reason: str = ""  # why, where it failed, has no water, or is to be done again
    seconds: float = 0.0
    method: str = ""
    corrected: float | None = None  # share of the pixels
    warnings: int = 0  # how many the sidecar holds


Say = Callable[[str, Any], None]
"""say("begin", name), say("end", Outcome)."""


def jobs_of(order: Order, scenes: Sequence[ListedScene], reads: Sequence[str] = ()) -> list[Job]:
    """The work on each scene; `reads` are files that were read beside the scenes and what the recipe names.

    Raises InputError: two scenes would be written to one file, or a file that is read would be written over.
    """
    jobs = []
    for scene in scenes:
        image = order.directory / order.name.replace("{name}", scene.name)
        stem = image.with_suffix("").name
        extras: Any = {name: image.with_name(f"{stem}_{name}{EXTRAS[name]}") for name in order.extras}
        jobs.append(Job(scene, Outputs(image, **extras)))
    names = Counter(path.name for job in jobs for path in job.outputs.every())
    for job in jobs:
        if twice := next((path for path in job.outputs.every() if names[path.name] > 1), None):
            them = ", ".join(j.scene.paths[0] for j in jobs if twice in j.outputs.every())
            raise InputError(
                f"several scenes would be written to {twice}: {them[:300]}. Give them names of their own, in a CSV "
                "with columns path and name."
            )
    # what is not there yet can be no file that is read
    there = [path for job in jobs for path in job.outputs.every() if path.exists()]
    if there:
        scenes_files = [p for job in jobs for name in job.scene.source for p in (name, *files_of(name))]
        named = [order.recipe.sample, order.recipe.mask, order.sensor or "", *reads]
        with environment():
            check_unread(there, {"a scene": scenes_files, "an input": named})
    return jobs


def state_of(job: Job, request: str) -> tuple[str, str]:
    """Whether a scene is finished, to do, or in the way of its doing ("failed"), and why."""
    image, sidecar, every = job.outputs.image, job.outputs.sidecar, job.outputs.every()
    there = [p for p in every if p.exists()]
    if not there:
        return TODO, ""
    if sidecar not in there:
        return FAILED, f"{there[0]} exists and was not made by this batch"
    try:
        said = read_json(str(sidecar), "sidecar")
        batch = said.get("batch") or {}
        inputs = {i["path"]: i for i in batch.get("inputs") or []}
        outputs = dict(batch.get("outputs") or {})
    except (DeglintError, KeyError, TypeError, ValueError, AttributeError):
        return FAILED, f"{sidecar} exists and is no sidecar of deglint"
    if batch.get("request") != request:
        return FAILED, f"{image} was made by another recipe"
    with environment():
        same = are_as([p for name in job.scene.source for p in files_of(name)], inputs)
    if not same:
        return FAILED, f"{image} was made of another state of the scene"
    if len(there) < len(every):
        return TODO, "was stopped while it was moved into place"
    changed = [p for p in every if p != sidecar and not is_as(p, outputs.get(p.name, {"bytes": -1}))]
    if changed:
        return FAILED, f"{changed[0]} is not as it was made"
    return FINISHED, ""


def outcome(job: Job, status: str, reason: str = "", seconds: float = 0.0, **more: Any) -> Outcome:
    """A row for a job."""
    inputs = ";".join(job.scene.paths)
    return Outcome(job.scene.name, inputs, str(job.outputs.image), status, reason, round(seconds, 3), **more)
