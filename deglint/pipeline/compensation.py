"""Decide how a scene is compensated, and fit it: a look at some tiles, the needs, the chain."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import tiles as tiling
from ..compensate import THESIS, Chain, Sample, Setting, State, Step, finish, fit_stages, parse, protect, system_psf
from ..compensate.chain import NO_STAGES, Sharpen
from ..compensate.estimate import Spectra, estimate_optics, glint_spectra
from ..compensate.evidence import Protection
from ..compensate.identify import IdentifyLevel
from ..compensate.level import SMALLEST
from ..compensate.median import Median
from ..compensate.opening import opening_halo
from ..compensate.protect import LEAST_DELAY
from ..compensate.psf import PSF
from ..compensate.reference import SIZE, ReferenceRule, fit_reference
from ..errors import FitError, InputError
from ..needs import (
    HIGH_PASS,
    LITTLE_COVER,
    PSF_COVER,
    SMALLEST_OBJECT,
    UNKNOWN_OBJECT,
    Needs,
    StageNeed,
    coherence,
    element_for,
)
from ..raster.environment import enter_thread
from ..readers.optics import optics_of, pixel_size
from ..remove import FitRequest, GlintModel, apply
from ..scene import Scene
from ..tiles import Tile
from .blocks import Blocks, read_blocks, some, tiles_of, workers
from .look import Look, core_of, raster_of
from .recipe import Recipe
from .sample import Sampler

Mask = npt.NDArray[np.bool_]
LEAST_SPREAD = 0.75
"""Of the step of a band's numbers: whole numbers cannot show a smaller standard deviation."""

NOMINAL_PITCH = 8e-6
"""Pitch that an f-number is estimated for [m]; the PSF in pixels does not depend on it."""
BLURRED = 0.2
"""Share of a point's light in its pixel, in the band that is blurred most, below which bands are matched."""
SHARP = 0.9
"""The same share from which on, in every band, sharpening gains less than a tenth of the noise."""
DARK_NOISE = 0.2
"""Share of the variance over water that does not grow with the signal, where nothing more is known of the noise."""


@dataclass(frozen=True)
class Plan:
    """What compensation a scene gets: the stages, what they need to be fitted, and why."""

    needs: Needs
    steps: tuple[Step, ...] = ()
    setting: Setting | None = None
    blocks: Blocks | None = None
    sampler: Sampler | None = None
    warnings: tuple[str, ...] = ()

    @property
    def runs(self) -> bool:
        """There are stages to run."""
        return any(step.name != "remove" for step in self.steps)

    @property
    def before(self) -> tuple[Step, ...]:
        """Stages before the removal."""
        return self.steps[: self._place]

    @property
    def after(self) -> tuple[Step, ...]:
        """Stages after it."""
        return self.steps[self._place + 1 :]

    @property
    def _place(self) -> int:
        return [s.name for s in self.steps].index("remove")


def plan(scene: Scene, recipe: Recipe, request: FitRequest, look: Look, sampler: Sampler | None, threads: int) -> Plan:
    """Look at some tiles and decide which stages run.

    Raises
    ------
    InputError
        A recipe that cannot be met.
    """
    pixel = pixel_size(scene)
    smallest = smallest_object(recipe.smallest_object, pixel)
    needs = Needs(pixel, smallest, element_for(smallest))
    if recipe.compensate == "off":
        return Plan(needs)
    wanted = (
        None if recipe.compensate == "auto" else parse(THESIS if recipe.compensate == "thesis" else recipe.compensate)
    )
    tiles = some(look.tiles) if sampler is None else tiles_of(scene, sampler)
    nir = request.indexes[0].bands[0]
    if wanted is None and not needs.element:
        why = f"things {smallest:.3g} pixels wide are to be kept, and an opening has {SMALLEST} or more"
        sample = read_blocks(scene, recipe, look, tiles, sampler, HIGH_PASS // 2, threads).sample
        needs = replace(needs, coherence=_alike(scene, sample, nir), offsets=_offsets(scene, nir))
        return Plan(replace(needs, stages=(StageNeed("opening", False, why),)))
    whole = _steps_of(scene)
    floor = None if whole is None else tuple(LEAST_SPREAD * step for step in whole)
    psfs = _psfs(scene, wanted)
    optics = "known" if psfs else "not looked for"
    setting = Setting(scene.bands, psfs, floor=floor, steps=whole)
    steps = wanted or parse(f"identify-level:{needs.element}, replace-level")
    usual = wanted or parse(
        f"psf:2, identify-level:{needs.element}, replace-level, remove, identify-level:{needs.element}"
    )
    blocks = read_blocks(scene, recipe, look, tiles, sampler, halo_of(usual, psfs), threads)
    sample = blocks.sample
    found = Plan(needs, steps, setting, blocks, sampler)
    alike = _alike(scene, sample, nir)
    if psfs is None and wanted is not None and _wants_psf(wanted):
        psfs, optics = estimated_psfs(scene, sample)
        setting = replace(setting, psfs=psfs)
        found = replace(found, setting=setting)
    needs = replace(needs, coherence=alike, offsets=_offsets(scene, nir), optics=optics)
    setting = replace(setting, detail=alike is not None and not needs.simultaneous)
    if wanted is not None:
        stages = tuple(StageNeed(s.name, True, "asked for") for s in wanted if s.name != "remove")
        return replace(found, needs=replace(needs, stages=stages), setting=setting)
    return _automatic(scene, replace(found, needs=needs, setting=setting), sample, threads)


def _alike(scene: Scene, sample: Sample, nir: int) -> float | None:
    """Coherence of the bands."""
    delayed = (_offsets(scene, nir) or 0.0) >= LEAST_DELAY
    return coherence([s.image for s in sample.states], sample.inside, scene.bands, nir, delayed=delayed)


def _automatic(scene: Scene, found: Plan, sample: Sample, threads: int) -> Plan:
    """The default chain, without what this scene does not need."""
    needs, setting = found.needs, found.setting
    assert setting is not None
    try:
        with workers(threads) as each:
            (stage,) = fit_stages([Step("identify-level", needs.element)], sample, setting, each=each)
    except FitError as error:
        return Plan(replace(needs, stages=(StageNeed("opening", False, str(error)),)))
    cover = stage.cover
    most = max(stage.certain)
    needs = replace(needs, cover=cover, certain=stage.certain)
    if most < LITTLE_COVER:
        why = f"at most {most:.3%} of a band is too bright for noise (threshold {LITTLE_COVER:.2%})"
        return Plan(replace(needs, stages=(StageNeed("compensation", False, why, "all of its time"),)))
    if setting.psfs is None:
        psfs, optics = estimated_psfs(scene, sample)
        needs, setting = replace(needs, optics=optics), replace(setting, psfs=psfs)
        found = replace(found, setting=setting)
    if needs.simultaneous and setting.psfs is not None and min(p.centre for p in setting.psfs) < BLURRED:
        why = "the bands see the sea at one instant, and are blurred over several pixels, each by its own wavelength"
        taken = "matched bands share their sparkle, and the removal takes it"
        both = (StageNeed("match", True, why), StageNeed("opening", False, taken, "half of its time"))
        return replace(found, needs=replace(needs, stages=both), steps=parse("match, remove"))
    text, stages = [], []
    middle = float(np.median(cover))
    if setting.psfs is None:
        stages.append(
            StageNeed("psf", False, "the optics are not known: sparkle is cut out less exactly", "a third of the time")
        )
    elif middle < PSF_COVER:
        stages.append(
            StageNeed(
                "psf",
                False,
                f"glint covers {middle:.1%} of the middlemost band (threshold {PSF_COVER:.0%})",
                "a third of the time",
            )
        )
    elif needs.simultaneous:
        stages.append(StageNeed("psf", False, "the bands see the sea at one instant", "a third of the time"))
    elif (share := min(p.centre for p in setting.psfs)) >= SHARP:
        why = f"the optics leave {share:.0%} of a point's light in its pixel (threshold {SHARP:.0%})"
        stages.append(StageNeed("psf", False, why, "a third of the time"))
    else:
        text.append("psf:2")
        stages.append(
            StageNeed("psf", True, f"glint covers {middle:.0%} of the middlemost band (threshold {PSF_COVER:.0%})")
        )
    text += [f"identify-level:{needs.element}", "replace-level", "remove"]
    why = f"up to {most:.2%} of a band is too bright for noise (threshold {LITTLE_COVER:.2%})"
    stages.append(StageNeed("opening", True, why))
    if needs.element - 2 >= SMALLEST:
        text += [f"identify-level:{needs.element - 2}", "replace-level"]
        stages.append(StageNeed("second opening", True, "what removal leaves is opened again"))
    return replace(found, needs=replace(needs, stages=tuple(stages)), steps=parse(", ".join(text)))


def fit_before(scene: Scene, recipe: Recipe, look: Look, found: Plan, threads: int) -> tuple[Chain, Blocks]:
    """Fit the stages before the removal; and the sample as they leave it."""
    assert found.setting is not None
    assert found.blocks is not None
    blocks, halo = found.blocks, halo_of(found.steps, found.setting.psfs)
    if halo > blocks.read:
        tiles = blocks.tiles
        blocks = read_blocks(scene, recipe, look, tiles, found.sampler, halo, threads)
    sample = blocks.sample
    raw = [s.image[(slice(None), *core)].copy() for s, core in zip(sample.states, blocks.cores(), strict=True)]
    in_place = not any(step.name == "normalise" for step in found.before)
    whole = None if in_place else [s.image.copy() for s in sample.states]
    with workers(threads) as each:
        stages = fit_stages(found.before, sample, found.setting, each=each)
    text = ", ".join(s.name + (f":{s.number:g}" if s.number else "") for s in found.steps)
    chain = Chain(stages, (), text, protection=_protection(raw, blocks, stages, found))
    images = [s.image if whole is None else finish(s, whole[i]) for i, s in enumerate(sample.states)]
    sample.states[:] = [State(image) for image in images]
    return chain, replace(blocks, halo=blocks.read - chain.halo_before)


def _protection(raw: list[Any], blocks: Blocks, stages: Sequence[Any], found: Plan) -> Protection:
    """How small things are told from sparkle, where an opening would erase them and the bands' instants can tell."""
    sample = blocks.sample
    levels = [s for s in stages if isinstance(s, IdentifyLevel)]
    assert found.setting is not None
    if not levels or any(s.water is None for s in sample.states) or len(levels[-1].bands) < len(found.setting.bands):
        return Protection(reason=NO_STAGES)
    if any((s.units != 1).any() for s in sample.states):
        return Protection(reason="the bands were normalised")
    if not found.setting.detail:
        return Protection(reason="the bands see the sea at one instant, as sparkle does")
    psfs = found.setting.psfs
    if psfs is not None and min(p.centre for p in psfs) < BLURRED:
        return Protection(reason="the optics blur sparkle over several pixels, and it looks like things")
    if not levels[-1].detail:
        cover = float(np.median(levels[-1].cover))
        return Protection(reason=f"glint covers {cover:.0%} of the middlemost band, and clumps of it look like things")
    looks, noise = [], []
    for block, state, mask, core in zip(raw, sample.states, sample.inside, blocks.cores(), strict=True):
        assert state.water is not None
        inner = mask[core]
        looks.append((np.where(inner, block, np.nan), np.where(inner, state.water[(slice(None), *core)], np.nan)))
    for b, sigma in enumerate(levels[-1].sigmas):
        level = max(float(np.nanmedian(np.concatenate([m[b][np.isfinite(m[b])] for _, m in looks]))), 1e-30)
        noise.append((DARK_NOISE * sigma**2, (1 - DARK_NOISE) * sigma**2 / level))
    try:
        return protect.fit(looks, found.setting.bands, noise=noise)
    except FitError as error:
        return Protection(reason=str(error))


def fit_after(recipe: Recipe, found: Plan, chain: Chain, blocks: Blocks, model: GlintModel, threads: int) -> Chain:
    """Fit the stages after the removal, on what it leaves; none unasked where it changed no band."""
    if not found.after or (not model.fits and recipe.compensate == "auto"):
        return chain
    assert found.setting is not None
    sample = blocks.sample
    levels = [s for s in chain.before if isinstance(s, IdentifyLevel)]
    setting = replace(found.setting, steps=None)  # what removal leaves is no whole number
    if levels:
        known = dict(zip(levels[-1].bands, levels[-1].sigmas, strict=True))
        setting = replace(setting, floor=tuple(known.get(b, 0.0) for b in range(len(found.setting.bands))))
    with workers(threads) as each:
        images = each(lambda s: np.asarray(apply(s.image, model, out=s.image)), sample.states)
        left = Sample([State(image) for image in images], sample.inside)
        bands = sorted(f.band for f in model.fits) or None
        after = fit_stages(found.after, left, setting, bands=bands, each=each)
    return replace(chain, after=after)


def fit_references(
    scene: Scene, model: GlintModel, sampler: Sampler, look: Look, threads: int
) -> tuple[tuple[int, ReferenceRule], ...]:
    """How far the NIR of glint stands out from the water around, over the sample; what exceeds it is not followed."""
    bands = [b for b in model.index_bands if b < len(scene.bands)]
    columns = sorted({*bands, *sampler.bands})
    halo = max(sampler.halo, SIZE // 2)

    def work(tile: Tile) -> tuple[Any, Mask]:
        outer = tile.grown(halo, scene.height, scene.width)
        block = scene.source.read(outer.window, columns)
        mask = np.asarray(sampler.mask(block, columns, outer))
        core = np.zeros_like(mask)
        core[core_of(tile.crop_of(outer), outer.shape)] = True
        return block[[columns.index(b) for b in bands]], mask & core

    tiles = tiles_of(scene, sampler)
    looks = [p for _t, p in tiling.run(tiles, work, threads=threads, start=enter_thread)]
    water_nir = look.water.threshold if look.water is not None and look.water.window == 1 else np.inf
    found = []
    for i, band in enumerate(bands):
        most = water_nir if look.water is not None and band == look.roles.nir else np.inf
        try:
            found.append((band, fit_reference([(b[i], m) for b, m in looks], most=most)))
        except FitError:  # too little water in one piece to tell: every pixel follows its own NIR
            continue
    return tuple(found)


def halo_of(steps: Sequence[Step], psfs: tuple[PSF, ...] | None) -> int:
    """Pixels around a tile that a chain will look at, once it is fitted."""
    total = 0
    for step in steps:
        size = int(step.number or 0)
        if step.name in ("psf", "psf-image") and psfs:
            total += Sharpen(psfs, size or 2, step.name == "psf-image").halo
        elif step.name == "identify-level":
            total += opening_halo(size or 13, size or 13)
        elif step.name == "match" and psfs:
            total += max(p.radius for p in psfs)
        elif step.name == "median":
            total += Median(size or 25).halo
    return total


def smallest_object(text: str | None, pixel: float | None) -> float:
    """Width of the smallest thing to keep [pixel], from "4m", "16px" or nothing.

    Raises
    ------
    InputError
        Not a length, or metres where the size of a pixel is not known.
    """
    if not text:
        return UNKNOWN_OBJECT if pixel is None else SMALLEST_OBJECT / pixel
    match = re.fullmatch(r"\s*([0-9.]+)\s*(px|pixels?|m|metres?|meters?)?\s*", text)
    try:
        value = float(match[1]) if match else float("nan")
    except ValueError:
        value = float("nan")
    if not (match and 0 < value < 1e6):
        raise InputError(f"--smallest-object {text!r} is not a width such as 4m or 16px.")
    if (match[2] or "m").startswith("p"):
        return value
    if pixel is None:
        raise InputError(f"--smallest-object {text}: the size of a pixel is not known; give pixels, such as 16px.")
    return value / pixel


def _psfs(scene: Scene, wanted: Sequence[Step] | None) -> tuple[PSF, ...] | None:
    """PSF of every band, where optics and wavelengths are known and a stage may want them."""
    if not _wants_psf(wanted):
        return None
    optics = optics_of(scene)
    wavelengths = [b.wavelength for b in scene.bands if b.wavelength is not None]
    if optics is None or len(wavelengths) < len(scene.bands):
        return None
    return tuple(system_psf(w, f_number=optics.f_number, pitch=optics.pitch, smear=optics.smear) for w in wavelengths)


def _wants_psf(wanted: Sequence[Step] | None) -> bool:
    return wanted is None or any(s.name.startswith(("psf", "match")) for s in wanted)


def estimated_psfs(scene: Scene, sample: Sample) -> tuple[tuple[PSF, ...] | None, str]:
    """PSF of every band from the sparkle in the image, where its optics are not known; and what to say of it."""
    wavelengths = [b.wavelength for b in scene.bands if b.wavelength is not None]
    if len(wavelengths) < len(scene.bands):
        return None, "unknown, and wavelengths are too"
    parts = [glint_spectra(np.where(m, s.image, np.nan)) for s, m in zip(sample.states, sample.inside, strict=True)]
    found = estimate_optics(Spectra.merge(parts), wavelengths, pitch=NOMINAL_PITCH)
    if found.f_number is None:
        return None, f"unknown: {found.reason}"
    psfs = tuple(system_psf(w, f_number=found.f_number, pitch=NOMINAL_PITCH) for w in wavelengths)
    return psfs, f"estimated: {found.reason}"


def _steps_of(scene: Scene) -> tuple[float, ...] | None:
    """Steps of each band's numbers, where those are whole numbers in the file."""
    info = raster_of(scene).info
    return tuple(abs(s) for s in info.scales) if info.dtype.kind in "iu" else None


def _offsets(scene: Scene, nir: int) -> float | None:
    """Longest time between the NIR and another band, as the file or sensor says [s]."""
    own = scene.bands[nir].time_offset
    others = [b.time_offset for i, b in enumerate(scene.bands) if i != nir and b.time_offset is not None]
    return None if own is None or not others else max(abs(t - own) for t in others)
