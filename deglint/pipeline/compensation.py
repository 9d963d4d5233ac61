"""Decide how a scene is compensated, and fit it: a look at some tiles, the needs, the chain."""

from __future__ import annotations

import re
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ..compensate import THESIS, Chain, Sample, Setting, State, Step, finish, fit_stages, parse, protect, system_psf
from ..compensate.chain import NO_STAGES
from ..compensate.estimate import Spectra, estimate_optics, glint_spectra
from ..compensate.evidence import Protection
from ..compensate.fitting import reach_of
from ..compensate.identify import TINY, IdentifyLevel, standing_out_of_outlines
from ..compensate.level import SMALLEST
from ..compensate.presence import Presence
from ..compensate.protect import LEAST_DELAY
from ..compensate.psf import PSF
from ..compensate.steps import step_of
from ..errors import FitError, InputError
from ..needs import (
    HIGH_PASS,
    LITTLE_GLINT,
    PSF_COVER,
    RARE_COVER,
    SMALLEST_OBJECT,
    UNKNOWN_OBJECT,
    Needs,
    StageNeed,
    coherence,
    element_for,
)
from ..readers.optics import optics_of, pixel_size
from ..remove import FitRequest, GlintModel, apply
from ..scene import Scene
from .blocks import Blocks, aside, inside, read_blocks, workers
from .calm import find_presence
from .look import Look, raster_of
from .recipe import Recipe
from .sample import Sampler, some, tiles_of

Mask = npt.NDArray[np.bool_]
Seen = tuple[list[Any], list[State], list[Mask], list[tuple[slice, slice]]]
"""Tiles as they were read, their blocks as the stages left them, the tiles' masks, and where they lie in the blocks."""
LEAST_SPREAD = 0.75
"""Of the step of a band's numbers: those cannot show a smaller standard deviation."""

NOMINAL_PITCH = 8e-6
"""Pitch that an f-number is estimated for [m]; the PSF in pixels does not depend on it."""
BLURRED = 0.2
"""Share of a point's light in its pixel, in the band that is blurred most, below which sparkle looks like things."""
SHARP = 0.9
"""The same share from which on, in every band, sharpening gains less than a tenth of the noise."""
LEFT_OUT = 0.0002
"""Share of the pixels too bright in the NIR for water from which on glint in the sample is less than in the scene."""
DARK_NOISE = 0.2
"""Share of the variance over water that does not grow with the signal, where nothing more is known of the noise."""


@dataclass(frozen=True)
class Plan:
    """What compensation a scene gets: the stages, what they need to be fitted, which bands they change, and why;
    and how parts without glint are known, where the removal is left out there."""

    needs: Needs
    steps: tuple[Step, ...] = ()
    setting: Setting | None = None
    blocks: Blocks | None = None
    sampler: Sampler | None = None
    reach: int = 0
    bands: tuple[int, ...] | None = None
    presence: Presence | None = None
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
    def left_alone(self) -> tuple[int, ...]:
        """Bands without glint: they are looked at for their outlines alone."""
        every = () if self.bands is None or self.setting is None else range(len(self.setting.bands))
        return tuple(b for b in every if b not in (self.bands or ()))

    @property
    def left(self) -> int:
        """Pixels around a tile that are looked at once the stages before the removal are through."""
        psfs = self.setting.psfs if self.setting else None
        return max(halo_of(self.after, psfs), self.reach)

    @property
    def halo(self) -> int:
        """Pixels around a tile that are looked at, at most."""
        return halo_of(self.before, self.setting.psfs if self.setting else None) + self.left

    @property
    def _place(self) -> int:
        return [s.name for s in self.steps].index("remove")


def plan(
    scene: Scene, recipe: Recipe, request: FitRequest, look: Look, sampler: Sampler | None, reach: int, threads: int
) -> Plan:
    """Look at some tiles and decide which stages run; the removal will look at `reach` pixels around each.

    Raises
    ------
    InputError
        A recipe that cannot be met.
    """
    pixel = pixel_size(scene)
    smallest = smallest_object(recipe.smallest_object, pixel)
    needs = Needs(pixel, smallest, element_for(smallest))
    if recipe.compensate == "off" or recipe.method == "wiener":
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
    psfs = _psfs(scene, wanted)
    optics = "known" if psfs else "not looked for"
    setting = Setting(scene.bands, psfs)
    steps = wanted or parse(f"identify-level:{needs.element}, replace-level")
    usual = wanted or parse(
        f"psf:2, identify-level:{needs.element}, replace-level, remove, identify-level:{needs.element}"
    )
    found = Plan(needs, steps, setting, None, sampler, reach)
    blocks = read_blocks(scene, recipe, look, tiles, sampler, replace(found, steps=usual).halo, threads)
    quanta = _steps_of(scene, blocks.sample)
    setting = replace(setting, floor=tuple(LEAST_SPREAD * step for step in quanta), steps=quanta)
    sample, found = blocks.sample, replace(found, blocks=blocks, setting=setting)
    alike = _alike(scene, sample, nir)
    if psfs is None and wanted is not None and _wants_psf(wanted):
        psfs, optics = estimated_psfs(scene, blocks)
        setting = replace(setting, psfs=psfs)
        found = replace(found, setting=setting)
    needs = replace(needs, coherence=alike, offsets=_offsets(scene, nir), optics=optics)
    setting = replace(setting, detail=alike is not None, witness=nir if needs.simultaneous else None)
    if wanted is not None:
        stages = tuple(StageNeed(s.name, True, "asked for") for s in wanted if s.name != "remove")
        return replace(found, needs=replace(needs, stages=stages), setting=setting)
    return _automatic(scene, replace(found, needs=needs, setting=setting), sample, nir, threads)


def may_open(scene: Scene, recipe: Recipe) -> bool:
    """Whether stages are likely to run, as far as the recipe and the size of the pixels tell."""
    return element_of(scene, recipe) > 0 if recipe.compensate == "auto" else recipe.compensate != "off"


def element_of(scene: Scene, recipe: Recipe) -> int:
    """Side of the element that leaves what is to be kept alone [pixel]; 0 where there is none, or nothing is opened."""
    if recipe.compensate != "off":
        with suppress(InputError):
            return element_for(smallest_object(recipe.smallest_object, pixel_size(scene)))
    return 0


def _alike(scene: Scene, sample: Sample, nir: int) -> float | None:
    """Coherence of the bands."""
    delayed = (_offsets(scene, nir) or 0.0) >= LEAST_DELAY
    return coherence([s.image for s in sample.states], sample.inside, scene.bands, nir, delayed=delayed)


def _glint_of(found: Plan, sample: Sample, nir: int, threads: int) -> Plan:
    """What glint the sample has and where it has none; and the element that is enough for it.

    Raises
    ------
    FitError
        Too few pixels to tell.
    """
    needs, setting = found.needs, found.setting
    assert setting is not None
    assert found.blocks is not None
    told = replace(setting, nir=nir)
    with workers(threads) as each:
        (stage,) = fit_stages([Step("identify-level", needs.element)], sample, told, each=each, cuts=None)
    known, calm = find_presence(found.blocks, needs, told, stage, threads)
    needs = replace(needs, cover=stage.cover, nir=_if_left_out(found.blocks, nir), calm=calm)
    needs = replace(needs, glint=stage.glint, things=stage.things)
    if float(np.median(stage.cover)) < RARE_COVER and needs.element - 2 >= SMALLEST:
        needs = replace(needs, element=needs.element - 2)
    if needs.in_doubt and stage.glint[nir] >= LITTLE_GLINT:
        with workers(threads) as each:
            (stage,) = fit_stages([Step("identify-level", needs.element)], sample, told, each=each, cuts=None)
            glint, things = standing_out_of_outlines(stage, sample.states, sample.inside, nir, each=each)
        needs = replace(needs, glint=glint, things=things)
    return replace(found, needs=needs, presence=known)


def _automatic(scene: Scene, found: Plan, sample: Sample, nir: int, threads: int) -> Plan:
    """The default chain, without what this scene does not need."""
    try:
        found = _glint_of(found, sample, nir, threads)
    except FitError as error:
        return Plan(replace(found.needs, stages=(StageNeed("opening", False, str(error)),)))
    needs, setting = found.needs, found.setting
    assert setting is not None
    most = max(needs.glint)
    if needs.smooth:
        why = f"glint adds at most {most:.2%} to a band's variance of noise (threshold {LITTLE_GLINT:.0%})"
        if most >= LITTLE_GLINT:
            why = f"what stands out is other bright things; glint adds at most {most:.1%} to a band's variance of noise"
        return Plan(replace(needs, stages=(StageNeed("compensation", False, why, "all of its time"),)))
    if setting.psfs is None:
        assert found.blocks is not None
        psfs, optics = estimated_psfs(scene, found.blocks)
        needs, setting = replace(needs, optics=optics), replace(setting, psfs=psfs)
        found = replace(found, setting=setting)
    text, stages = [], []
    middle = float(np.median(needs.cover))
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
    why = f"glint adds up to {most:.3g} times a band's variance of noise (threshold {LITTLE_GLINT:g})"
    bands: tuple[int, ...] | None = None
    if len(needs.glinted) < len(scene.bands):
        bands = needs.glinted
        alone = ", ".join(name for b, name in enumerate(scene.names) if b not in bands)
        why += f"; not in {alone}, where it adds less, or less than other bright things"
    stages.append(StageNeed("opening", True, why))
    if needs.element - 2 >= SMALLEST:
        text += [f"identify-level:{needs.element - 2}", "replace-level"]
        stages.append(StageNeed("second opening", True, "what removal leaves is opened again"))
    return replace(found, needs=replace(needs, stages=tuple(stages)), steps=parse(", ".join(text)), bands=bands)


def _if_left_out(blocks: Blocks | None, nir: int) -> int | None:
    """The NIR, where pixels too bright in it are left out of the sample: flashes, most of them, if there is glint."""
    if blocks is None:
        return None
    inside = [m[core] for m, core in zip(blocks.sample.inside, blocks.cores(), strict=True)]
    out = 1 - sum(int(m.sum()) for m in inside) / max(sum(m.size for m in inside), 1)
    return nir if out > LEFT_OUT else None


def fit_before(
    scene: Scene, recipe: Recipe, look: Look, found: Plan, threads: int
) -> tuple[Chain, Blocks, Future[Protection]]:
    """Fit the stages before the removal; the sample as they leave it; and the protection, which is worked out aside."""
    assert found.setting is not None
    assert found.blocks is not None
    blocks = found.blocks
    if found.halo > blocks.read:
        blocks = read_blocks(scene, recipe, look, blocks.tiles, found.sampler, found.halo, threads)
    sample, left = blocks.sample, replace(blocks, halo=found.left, read=found.left)
    raw = [s.image[(slice(None), *core)].copy() for s, core in zip(sample.states, blocks.cores(), strict=True)]
    cuts = blocks.margins(found.left)
    in_place = not any(step.name == "normalise" for step in found.before)
    whole = None if in_place else [inside(s.image, cut).copy() for s, cut in zip(sample.states, cuts, strict=True)]
    with workers(threads) as each:
        stages = fit_stages(
            found.before, sample, found.setting, bands=found.bands, left=found.left_alone, each=each, cuts=cuts
        )
    seen = (
        raw,
        list(sample.states),
        [m[core] for m, core in zip(sample.inside, left.cores(), strict=True)],
        left.cores(),
    )
    protection = aside(partial(_protection, seen, stages, found, threads))
    text = ", ".join(s.name + (f":{s.number:g}" if s.number else "") for s in found.steps)
    images = [s.image if whole is None else finish(s, whole[i]) for i, s in enumerate(sample.states)]
    sample.states[:] = [State(image) for image in images]
    return Chain(stages, (), text, presence=found.presence), left, protection


def _protection(seen: Seen, stages: Sequence[Any], found: Plan, threads: int) -> Protection:
    """How small things are told from sparkle, where an opening would erase them and the bands' instants can tell."""
    raw, states, masks, cores = seen
    levels = [s for s in stages if isinstance(s, IdentifyLevel)]
    assert found.setting is not None
    if not levels or any(s.water is None for s in states):
        return Protection(reason=NO_STAGES)
    if len(levels[-1].bands) - len(levels[-1].left) < len(found.setting.bands):
        return Protection(reason="there is little glint, and not in every band")
    if any((s.units != 1).any() for s in states):
        return Protection(reason="the bands were normalised")
    if not found.setting.detail or found.setting.witness is not None:
        return Protection(reason="the bands see the sea at one instant, as sparkle does")
    psfs = found.setting.psfs
    if psfs is not None and min(p.centre for p in psfs) < BLURRED:
        return Protection(reason="the optics blur sparkle over several pixels, and it looks like things")
    if not levels[-1].detail:
        cover = float(np.median(levels[-1].cover))
        return Protection(reason=f"glint covers {cover:.0%} of the middlemost band, and clumps of it look like things")
    if min(levels[-1].sigmas) <= TINY:
        return Protection(reason="a band has no noise, so that nothing tells what stands out of it")
    looks, noise = [], []
    for block, state, mask, core in zip(raw, states, masks, cores, strict=True):
        assert state.water is not None
        water = state.water[(slice(None), *core)]
        looks.append((block, water) if mask.all() else (np.where(mask, block, np.nan), np.where(mask, water, np.nan)))
    with ThreadPoolExecutor(threads, thread_name_prefix="deglint") as pool:
        middles = pool.map(
            lambda b: np.median(np.concatenate([m[b][np.isfinite(m[b])] for _, m in looks])), range(len(raw[0]))
        )
        for sigma, middle in zip(levels[-1].sigmas, middles, strict=True):
            noise.append((DARK_NOISE * sigma**2, (1 - DARK_NOISE) * sigma**2 / max(float(middle), 1e-30)))
        try:
            return protect.fit(looks, found.setting.bands, noise=noise, each=pool.map)
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
    if setting.witness is not None and not levels:  # nothing has told outlines of things from those of sparkle
        setting = replace(setting, detail=False)
    if levels:
        known = dict(zip(levels[-1].bands, levels[-1].sigmas, strict=True))
        floor = tuple(known.get(b, 0.0) for b in range(len(found.setting.bands)))
        setting = replace(setting, floor=floor, cover=float(np.median(levels[-1].cover)))
    with workers(threads) as each:
        images = each(lambda s: np.asarray(apply(s.image, model, out=s.image)), sample.states)
        left = Sample([State(image) for image in images], sample.inside)
        bands = sorted(f.band for f in model.fits if found.bands is None or f.band in found.bands) or None
        passed = set(range(len(found.setting.bands))) - {f.band for f in model.fits} - set(model.index_bands)
        beside = sorted({*found.left_alone, *passed})  # things show in bands that glint was hardly seen in, too
        after = fit_stages(found.after, left, setting, bands=bands, left=beside, each=each, cuts=None)
    return replace(chain, after=after)


def halo_of(steps: Sequence[Step], psfs: tuple[PSF, ...] | None) -> int:
    """Pixels around a tile that a chain will look at, once it is fitted."""
    return sum(reach_of(step, psfs) for step in steps)


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
    return wanted is None or any(s.name.startswith("psf") for s in wanted)


def estimated_psfs(scene: Scene, blocks: Blocks) -> tuple[tuple[PSF, ...] | None, str]:
    """PSF of every band from the sparkle in the image, where its optics are not known; and what to say of it."""
    wavelengths = [b.wavelength for b in scene.bands if b.wavelength is not None]
    if len(wavelengths) < len(scene.bands):
        return None, "unknown, and wavelengths are too"
    sample, parts = blocks.sample, []
    for state, mask, core in zip(sample.states, sample.inside, blocks.cores(), strict=True):
        parts.append(glint_spectra(np.where(mask[core], state.image[(slice(None), *core)], np.nan)))
    found = estimate_optics(Spectra.merge(parts), wavelengths, pitch=NOMINAL_PITCH)
    if found.f_number is None:
        return None, f"unknown: {found.reason}"
    psfs = tuple(system_psf(w, f_number=found.f_number, pitch=NOMINAL_PITCH) for w in wavelengths)
    return psfs, f"estimated: {found.reason}"


def _steps_of(scene: Scene, sample: Sample) -> tuple[float, ...]:
    """Steps of each band's numbers: of whole numbers in the file, or those that the sample shows; 0 for none."""
    info = raster_of(scene).info
    if info.dtype.kind in "iu":
        return tuple(abs(s) for s in info.scales)
    parts = list(zip(sample.states, sample.inside, strict=True))
    return tuple(step_of(np.concatenate([s.image[b][m] for s, m in parts])) for b in range(len(scene.bands)))


def _offsets(scene: Scene, nir: int) -> float | None:
    """Longest time between the NIR and another band, as the file or sensor says [s]."""
    own = scene.bands[nir].time_offset
    others = [b.time_offset for i, b in enumerate(scene.bands) if i != nir and b.time_offset is not None]
    return None if own is None or not others else max(abs(t - own) for t in others)
