"""What a scene does not need: which stages are skipped, the time that saves, the error it adds; and plain copies."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from deglint import Recipe, open_scene, remove_glint
from deglint.errors import NoWaterError
from deglint.physics.presets import preset
from deglint.raster.simulated import write_scene
from deglint.simulate import SimulatedScene, simulate, simulate_together

from . import copying
from .measure import Float64, rms_error
from .section import Cell, Effort, Number, Section, Table, over_seeds, timed
from .simulated import setups
from .tradeoff_measure import chain, spent

WIND, DELAY = 9.0, 0.060
FORCED = Recipe(method="multiband", compensate=chain(2), mask="none")
"""Every stage of the default chain, whatever the scene is like."""
STAGES = ("psf", "opening", "second opening", "removal")
QUICK = ("glint, bands apart", "no glint", "no delay", "half nodata", "all land")
LAND = (0.06, 0.09, 0.12, 0.15, 0.20, 0.45, 0.70, 0.75)
"""Of full scale, by band."""


@dataclass(frozen=True)
class Case:
    """One kind of scene: digital numbers, the truth in radiance where there is one, nodata, and the setup."""

    name: str
    made: SimulatedScene
    image: Any
    nodata: bool = False
    water: bool = True


@dataclass
class Ran:
    """What a kind of scene gave, over seeds.

    Attributes
    ----------
    stages : dict of str to str
        "runs", or "skipped: why", of the first seed.
    saved : list of float
        Share of the processor time of the full chain.
    error, forced, noise : list of float
        RMS error of the default, of the full chain, and of noise alone [% of the water level]; NaN without a truth.
    refused : str
        Why nothing was written.
    """

    stages: dict[str, str]
    saved: list[float]
    error: list[float]
    forced: list[float]
    noise: list[float]
    refused: str = ""


def run(effort: Effort) -> Section:
    """Measure, and write the chapter."""
    found: dict[str, Ran] = {}
    for seed in range(1 if effort.quick else min(effort.seeds, 2)):
        for case in cases(seed, 1 if effort.quick else 2):
            if effort.quick and case.name not in QUICK:
                continue
            one = ran(case, effort, warm=not found)
            if case.name in found:
                for name in ("saved", "error", "forced", "noise"):
                    getattr(found[case.name], name).extend(getattr(one, name))
            else:
                found[case.name] = one
    return section(found, copying.measure(effort))


def cases(seed: int, times: int = 1) -> Iterator[Case]:
    """The kinds of scenes, all of one sea, laid side by side so many times each way."""
    base = preset("thesis")
    clean = replace(base.delayed(DELAY), name="sharp", f_number=2.0, smear=0.0)
    every = setups([base.delayed(DELAY), base.delayed(0.0), clean], WIND, seed)
    seen = [*simulate_together(every), simulate(replace(every[1], objects=()))]
    apart, together, sharp, calm = (_laid(one, times) for one in seen)
    rows, columns = apart.image.shape[1:]
    yield Case("glint, bands apart", apart, apart.image)
    yield Case("objects, no glint", apart, apart.truth_image)
    yield Case("no glint", calm, calm.truth_image)
    corner = apart.truth_image.copy()
    corner[:, : rows // 2, : columns // 2] = apart.image[:, : rows // 2, : columns // 2]
    yield Case("glint in a corner", apart, corner)
    yield Case("no delay", together, together.image)
    yield Case("clean optics", sharp, sharp.image)
    half = apart.image.copy()
    half[:, :, columns // 2 :] = 0
    yield Case("half nodata", apart, half, nodata=True)
    level = np.array(LAND)[:, None, None] * apart.setup.sensor.levels
    texture = np.random.default_rng(seed).normal(1, 0.1, apart.image.shape)
    yield Case("all land", apart, (level * texture).clip(1, apart.setup.sensor.levels).astype(np.uint16), water=False)


def _laid(made: SimulatedScene, times: int) -> SimulatedScene:
    arrays: dict[str, Any] = {
        name: np.tile(getattr(made, name), (1, times, times)) for name in ("image", "truth", "truth_image")
    }
    return replace(made, **arrays)


def ran(case: Case, effort: Effort, *, warm: bool) -> Ran:
    """A kind of scene by default and with every stage, one after the other; files are gone afterwards."""
    source = _written(case, effort.directory)
    out = effort.directory / "skipping-out.tif"

    def work(recipe: Recipe) -> Callable[[], Any]:
        options: dict[str, Any] = {"threads": 1, "overwrite": True, "nodata": 0.0 if case.nodata else None}
        return lambda: remove_glint(source, out, recipe, **options)

    try:
        if warm:  # what is loaded at the first use is no time of a stage
            for recipe in (Recipe(), FORCED):
                work(recipe)()
        every = FORCED if case.water else replace(FORCED, sample="all")
        full, _ = spent(work(every))
        forced = _error(case, out)
        own, result = spent(lambda: _refused(work(Recipe())))
        if not effort.quick:
            full, own = min(full, spent(work(every))[0]), min(own, spent(lambda: _refused(work(Recipe())))[0])
        if isinstance(result, NoWaterError):
            said = f"skipped: {result}"
            return Ran(dict.fromkeys(STAGES, said), [1 - own / full], [], [], [], str(result))
        return Ran(_stages(result), [1 - own / full], _error(case, out), forced, _noise(case))
    finally:
        for path in (source, out, Path(f"{out}.json"), source.with_suffix(".json")):
            path.unlink(missing_ok=True)


def _refused(work: Callable[[], Any]) -> Any:
    """What some work gives, or its refusal of a scene without water."""
    try:
        return work()
    except NoWaterError as refusal:
        return refusal


def _written(case: Case, directory: Path) -> Path:
    made = replace(case.made, image=case.image)
    return write_scene(made, directory / "skipping", overwrite=True, truth=False)[0]


def _stages(result: Any) -> dict[str, str]:
    needs, fits = result.fitted.needs, result.fitted.model.fits
    out = {s.stage: "runs" if s.runs else f"skipped: {s.why}" for s in needs.stages}
    whole = out.pop("compensation", None)
    if whole:
        out |= dict.fromkeys(("psf", "opening", "second opening"), whole)
    out["removal"] = "runs" if fits else "skipped: no band follows the NIR"
    return out


def _scaled(case: Case, image: Any) -> Float64:
    sensor = case.made.setup.sensor
    return np.asarray(image * np.array([sensor.scale(b) for b in sensor.bands])[:, None, None])


def _columns(case: Case) -> slice:
    return slice(case.image.shape[2] // 2) if case.nodata else slice(None)


def _error(case: Case, out: Path) -> list[float]:
    if not case.water:
        return []
    return [rms_error(open_scene(out).read(), case.made.truth, _columns(case))]


def _noise(case: Case) -> list[float]:
    return [rms_error(_scaled(case, case.made.truth_image), case.made.truth, _columns(case))] if case.water else []


def section(found: dict[str, Ran], copies: copying.Copies) -> Section:
    """The chapter of what was found."""
    rows: list[tuple[Cell, ...]] = []
    out: dict[str, Number] = {}
    for name, one in found.items():
        key = "skipping/" + name.replace(", ", "-").replace(" ", "-")
        out[f"{key}/saved"] = timed([100 * s for s in one.saved], "%", "higher")
        cells: list[Cell] = [name, *(one.stages.get(s, "").split(":")[0] or "-" for s in STAGES), out[f"{key}/saved"]]
        if one.error:
            added = [a - b for a, b in zip(one.error, one.forced, strict=True)]
            out[f"{key}/added"] = over_seeds(added, "%")
            out[f"{key}/rms"] = over_seeds(one.error, "%")
            below = "yes" if max(added) < min(one.noise) else "no"
            cells += [out[f"{key}/rms"], over_seeds(one.forced, "%"), out[f"{key}/added"],
                      float(np.mean(one.noise)), below]  # fmt: skip
        else:
            cells += ["refused", "", "", "", ""]
        rows.append(tuple(cells))
    head = ("scene", *STAGES, "time saved [%]", "error [%]", "with every stage [%]", "added [%]", "noise alone [%]",
            "added is below noise")  # fmt: skip
    note = "Errors in percent of the water level; time: processor time of the whole run, against every stage forced."
    table = Table.of("What runs, and what leaving it out does", head, rows, note)
    reasons = _reasons(found)
    return Section("skipping", "What a scene does not need", _said(found), (table, reasons), (), out,
                   (copying.section(copies),), finding(found, copies))  # fmt: skip


def _reasons(found: dict[str, Ran]) -> Table:
    """Why stages were skipped, a row a reason."""
    rows: dict[tuple[str, str], list[str]] = {}
    for name, one in found.items():
        for stage, said in one.stages.items():
            if said.startswith("skipped: "):
                rows.setdefault((name, said.partition(": ")[2]), []).append(stage)
    cells = [(name, ", ".join(stages), why) for (name, why), stages in rows.items()]
    return Table.of("Why a stage was skipped", ("scene", "stages", "why"), cells)


def finding(found: dict[str, Ran], copies: copying.Copies) -> str:
    """For the head of the report."""
    ratio = copies.ratio(max(copies.sides), "cog")
    saved = 100 * max(max(r.saved) for r in found.values() if r.error)
    gain = f"up to {saved:.0f} %" if saved >= 1 else "none"
    return (
        f"Skipping what a scene does not need saves {gain} of the time and adds {_most(found):.2g} "
        f"% of the water level at most; a scene that needs nothing is copied bit for bit in {ratio:.2g} times the time "
        "of a block copy."
    )


def _most(found: dict[str, Ran]) -> float:
    return max(a - b for one in found.values() for a, b in zip(one.error, one.forced, strict=True))


def _said(found: dict[str, Ran]) -> tuple[str, ...]:
    noise = min(min(one.noise) for one in found.values() if one.noise)
    refused = [f"{name}: {one.refused}" for name, one in found.items() if one.refused]
    said = (
        f"Kinds of scenes of one sea at {WIND:g} m/s, each by default and with every stage of the chain forced. "
        f"Leaving stages out adds at most {_most(found):.2g} % of the water level, where noise alone is {noise:.2g} %; "
        "below 0, the stage would have done harm."
    )
    if refused:
        said += f" Nothing is written where there is no water ({'; '.join(refused)})."
    return (said,)
