"""Run candidates on sample tiles, with and without implanted signals, and choose the best."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial

import cv2
import numpy as np

from ..compensate import FitRemoval, FittedChain, Posterior, Sample, Setting, clump_width, fit_chain, with_targets
from ..errors import FitError
from ..moments import Float64, Mask
from ..morphology import grown
from ..remove.detrend import LOCAL_MEAN
from ..remove.levels import even_share
from ..remove.mixture import WATER_PERCENTILE
from ..remove.noise import spread
from ..remove.reference import OFTEN
from .candidates import Candidate, candidates
from .implants import SCALES, Float32, Implants, gains, implants
from .score import EDGES, erased, expected_errors, least_glint, least_signal, level_excess, partners, powers

EQUAL_ERRORS = 1.1
"""Candidates are equally good if their errors are at most this factor times the least; the simplest is chosen. Expected
errors are wrong by a factor of 1.5 in the median, so that a smaller difference of two candidates may be chance."""
WORTH_REMOVING = 0.85  # a copy changes nothing: other candidates must promise an error below this fraction of its error
CERTAIN = 5.0
"""A removal is refused unless its slope on the NIR exceeds zero by this many standard errors in some band: more than
the 3 of a fit (`wiener.SURE`), since ships, surf and mud, which are bright in the NIR, are not noise."""
LEVEL_FAULT = 1 / 3
"""Share of the excess of the level (`level_excess`) that counts as an error of a removal, or of an opening: the level
of one may be too bright, but the level of the other may also be too dark."""
LARGEST_DISC = 16.0  # width of the widest implanted disc [pixel]: every window that is tried preserves wider ones
NOT_JUDGED = 5
"""Pixels around targets and ships that are excluded from the evaluation: blur, wakes, and the windows of textures."""
FAR_OUT = 8.0  # least contrast of a ship with its surroundings [robust standard deviations]
EVEN, MIRRORED = 0.55, 0.2
"""Mirrored sky has at least this even share (`even_share`), and at most this standard deviation relative to the water.
Dense sun glint has a similar even share, but a larger standard deviation; sparse sun glint has a smaller even share."""
WIENER = Candidate("wiener", "wiener")  # for samples on which candidates cannot be tried
LEAST_TRIED = 2000  # fewest pixels of water with which candidates are tried: fewer pixels do not determine texture


@dataclass(frozen=True)
class Trial:
    """Result of trying a candidate on the sample tiles: texture, gains of implanted signals, and expected error."""

    candidate: Candidate
    power: tuple[float, ...]  # mean square of the texture at each of `SCALES`, relative to the water squared
    gains: dict[str, float]  # gain of each implanted signal, by name [1]
    error: float = float("nan")  # expected root mean square error, relative to the water

    @property
    def signals(self) -> Float64:
        """Gain of the textures implanted at `SCALES`, (scale,); at the coarsest scale, the gain of the plumes."""
        return np.array([*(v for k, v in self.gains.items() if k.startswith("texture")), self.gains["plumes"]])

    @property
    def kept(self) -> str:
        """Text with the preserved share of implanted discs, plumes and targets [%]."""
        said = [f"{k} {max(min(v, 1.0), 0.0):.0%}" for k, v in self.gains.items() if not k.startswith("texture")]
        return f"share of signal kept: {', '.join(said)}"


@dataclass(frozen=True)
class Choice:
    """The result of `choose`: the candidates that were tried, and the best of them."""

    best: Candidate
    trials: tuple[Trial, ...] = ()  # simplest candidate first; empty where nothing could be tried
    failed: dict[str, str] = field(default_factory=dict)  # why candidates could not be fitted or were refused, by name
    width: float = 0.0  # width of the smallest object to keep, at most `LARGEST_DISC` where discs were added [pixel]

    @property
    def trial(self) -> Trial | None:
        """Trial of the best candidate; None where nothing was tried."""
        return next((t for t in self.trials if t.candidate == self.best), None)

    @property
    def why_copied(self) -> str:
        """Reason why the scene is copied; only for a choice whose best candidate is the copy."""
        others = [t for t in self.trials if t.candidate.method != "copy"]
        if not others:
            why = self.failed.get("wiener", "no candidate could be tried")
            return why.removesuffix("Nothing was corrected.").rstrip(". ")
        least = min(others, key=lambda t: t.error)
        return (
            f"the expected error is {self.trials[0].error:.1%} of the water without a correction and {least.error:.1%} "
            f"with the best one ({least.candidate.name}), which should be less than {WORTH_REMOVING:.0%} of the "
            "former: the bands share too little glint"
        )

    @property
    def why(self) -> str:
        """Reason why the best candidate was chosen."""
        if (trial := self.trial) is None:
            return "candidates not tried: too little water, or values too large"
        how = f"within {EQUAL_ERRORS - 1:.0%} of the least expected error"
        return f"simplest of {len(self.trials)} candidates {how}: error {trial.error:.1%} of the water; {trial.kept}"

    def lines(self) -> list[str]:
        """Lines of text for the log: the choice, and one line for each candidate."""
        out, trial = list[str](), self.trial
        if self.best.method == "copy" and trial is None:
            out.append("no removal can be used: the scene is copied")
        elif trial is not None:
            said = f"{trial.kept} (discs are {max(self.width, 1):.3g} pixels wide)"
            out.append(f"chosen: {self.best.name}; expected error {trial.error:.1%} of the water; {said}")
        out += [f"  {t.candidate.name}: expected error {t.error:.1%}; {t.kept}" for t in self.trials]
        return out + [f"  {name}: refused, {why}" for name, why in self.failed.items()]

    def numbers(self) -> dict[str, object]:
        """The choice as plain values for the sidecar."""
        return {
            "best": self.best.name,
            "smallest_object_pixels": self.width,
            "scales_pixels": list(SCALES),
            "trials": [{"name": t.candidate.name, **asdict(t)} for t in self.trials],
            "not_tried": self.failed,
        }


@dataclass(frozen=True, eq=False)
class _Run:
    """Result of a candidate on the sample tiles."""

    images: list[Float32]  # (band, row, column) of each tile
    targets: list[Float32 | None]  # (band, row, column) of each tile: contrast of targets that the candidate recognised


def choose(
    sample: Sample,
    setting: Setting,
    correct: Sequence[int],
    removal: Callable[[str], FitRemoval],
    *,
    width: float,
    fine: bool = False,
) -> Choice:
    """Try candidate recipes on sample tiles, and choose the simplest of those with nearly the least expected error.

    sample : tiles, and masks of the pixels to use, as returned by `without_ships` unless pixels are fine
    correct : 0-based bands to correct; candidates are judged by these bands only
    removal : returns, for the name of a method, the function that fits it to a sample
    width : width of the smallest object to keep [pixel]
    fine : True if pixels resolve sparkle: a candidate that removes mirrored sky instead of sparkle is then refused

    The best candidate is "copy", which changes nothing, if no other is much better (`WORTH_REMOVING`) or no band
    varies. It is "wiener" if there are too few pixels to try others, or if values are too large.
    """
    if _too_small(sample):
        return Choice(WIENER, width=width)
    values = sample.values([s.image for s in sample.states])
    judged = [b for b in correct if np.ptp(values[b]) > 0]  # not a dead band
    if not judged:
        return Choice(Candidate("copy", "copy"), failed={"wiener": "no band varies over the sample"}, width=width)
    level, disc = _levels(sample), min(width, LARGEST_DISC)
    unit = np.where(np.isin(np.arange(len(level)), judged), level, np.float32(np.inf))
    added = [implants(m, setting.bands, level, disc, n) for n, m in enumerate(sample.inside)]
    marked = _marked(sample, added)

    runs, failed = dict[Candidate, tuple[_Run, _Run]](), dict[str, str]()
    for candidate in candidates(setting, width=width, clump=clump_width(sample, setting.nir[0])):
        fit = removal(candidate.method)
        try:
            plain = _run(candidate, sample, setting, fit, partial(_check, fine=unit if fine else None))
            runs[candidate] = plain, _run(candidate, marked, setting, fit)
        except FitError as error:
            failed[candidate.name] = str(error)
    if len(runs) == 1:  # the copy alone, whose error can be computed only beside another candidate
        return Choice(next(iter(runs)), failed=failed, width=disc)
    trials = _judged(runs, sample, added, unit, setting)
    if not np.isfinite(trials[0].error):  # numbers beyond float32: not even a copy can be judged
        return Choice(WIENER, failed=failed, width=disc)
    return Choice(_best(trials).candidate, tuple(trials), failed, disc)


def _marked(sample: Sample, added: Sequence[Implants]) -> Sample:
    """The sample with signals added to its tiles."""
    images = [s.image + a.total for s, a in zip(sample.states, added, strict=True)]
    states = tuple(replace(s, raw=i, image=i) for s, i in zip(sample.states, images, strict=True))
    return replace(sample, states=states)


def _best(trials: Sequence[Trial]) -> Trial:
    """First of the equally good trials (`EQUAL_ERRORS`); but if it is not much better than the copy (`WORTH_REMOVING`),
    the copy, `trials[0]`.
    """
    least = min(t.error for t in trials)
    best = next(t for t in trials if t.error <= EQUAL_ERRORS * least)
    return best if best.error < WORTH_REMOVING * trials[0].error else trials[0]


def _judged(
    pairs: dict[Candidate, tuple[_Run, _Run]],
    sample: Sample,
    added: Sequence[Implants],
    unit: Float32,
    setting: Setting,
) -> list[Trial]:
    """Trial of each pair of runs, without and with the signals `added`; an error that is NaN is set to infinity."""
    runs = {c: plain for c, (plain, _) in pairs.items()}
    inside = _without_targets(without_shore(sample), list(runs.values()))
    partner_of, results = partners(setting, unit), [r.images for r in runs.values()]

    def measured(candidate: Candidate) -> Trial:
        plain, marked = (run.images for run in pairs[candidate])
        responses = [b - a for a, b in zip(plain, marked, strict=True)]
        return Trial(candidate, tuple(powers(plain, inside, unit).tolist()), gains(responses, added, inside, unit))

    def shared(clear: Sequence[Mask]) -> Float64:
        """Power that bands share with their partners, (recipe, scale); over all pixels if `clear` is empty."""
        return np.array([powers(images, inside, unit, clear, partner_of) for images in results])

    trials = [measured(c) for c in pairs]
    left, spectrum = np.array([t.power for t in trials]), _spectrum(setting)
    errors = expected_errors(
        left,
        (shared(()) if partner_of else left, shared(_clear(runs, inside))),
        np.array([t.signals for t in trials]),
        np.array([t.gains["discs"] for t in trials]),
        0.0 if spectrum is None else _own_signal(sample, inside, unit, setting, spectrum),
        EDGES if setting.delayed else 0.0,  # of simultaneous bands the posterior mean is good, too
    )
    opened = [c.opens for c in runs]
    if any(opened) and any(m.any() for m in inside):
        kinds = [None if c.method == "copy" else c.opens for c in runs]
        errors = np.hypot(errors, LEVEL_FAULT * level_excess(results, inside, unit, kinds, setting.delayed))
    if spectrum is not None:
        for n in np.flatnonzero(opened):
            taken = [s.image - image for s, image in zip(sample.states, results[n], strict=True)]
            errors[n] = np.hypot(errors[n], erased(taken, inside, unit, setting.nir[0], spectrum))
    return [replace(t, error=float(e) if np.isfinite(e) else np.inf) for t, e in zip(trials, errors, strict=True)]


def _spectrum(setting: Setting) -> Float32 | None:
    """Glint in each band, (band,), over that in the NIR, at least 1; None if a wavelength is not in 300 to 1000 nm."""
    if (setting.colour == 1).all():
        return None
    return np.maximum(setting.colour / setting.colour[setting.nir[0]], 1)  # of radiance or reflectance, the larger


def _own_signal(sample: Sample, inside: Sequence[Mask], unit: Float32, setting: Setting, spectrum: Float32) -> Float64:
    """`least_signal`, but all bands except the NIR are clipped at percentile `OFTEN`: the NIR may miss rare flashes."""
    images, nir = [s.image for s in sample.states], setting.nir[0]
    noises = replace(sample, inside=tuple(inside)).noise_of(images).astype(np.float32)
    high = [np.inf if b == nir else np.percentile(v, OFTEN) for b, v in enumerate(sample.values(images))]
    images = [np.minimum(i, np.array(high, np.float32)[:, None, None]) for i in images]
    return least_signal(images, inside, unit, noises, nir, spectrum)


def _run(
    candidate: Candidate,
    sample: Sample,
    setting: Setting,
    removal: FitRemoval,
    check: Callable[[FittedChain], None] = lambda _fitted: None,
) -> _Run:
    """Fit a candidate to sample tiles, call `check` with the fit, and run it. Raises FitError if no fit is possible."""
    if candidate.method == "copy":
        return _Run([s.image for s in sample.states], [])
    fitted = fit_chain("remove" if candidate.chain == "off" else candidate.chain, sample, setting, removal)
    check(fitted)
    states = fitted.sample.states
    return _Run([with_targets(s) for s in states], [s.targets for s in states])


def _check(fitted: FittedChain, fine: Float32 | None) -> None:
    """Raise FitError if a candidate changes nothing, has no slope clearly above 0 (`CERTAIN`), or cannot distinguish
    residual glint from water. If `fine`, the brightness of water (band,), is given, also refuse a removal of sky.
    """
    if not fitted.model.fits and not fitted.chain.replaces:
        raise FitError(next(iter(fitted.model.warnings), "the removal changes no band"))
    if max((f.slope / f.stderr for f in fitted.model.fits if f.stderr), default=np.inf) < CERTAIN:
        raise FitError(f"no slope on the NIR is {CERTAIN:g} standard errors above zero: the bands may share no glint")
    if fine is not None and not fitted.chain.replaces:
        _refuse_sky(fitted, fine)
    if not all(stage.resolved for stage in fitted.chain.after if isinstance(stage, Posterior)):
        raise FitError("the residual hardly varies more under strong glint than under weak: it may be water texture")


def _too_small(sample: Sample) -> bool:
    """Whether a sample has too few pixels to try candidates."""
    return sum(int(m.sum()) for m in sample.inside) < LEAST_TRIED


def without_ships(sample: Sample) -> Sample:
    """The sample without ships (pixels far brighter than the water around) and pixels near them. With ships in it, a
    recipe that erases them would get too small an error. Not for fine pixels, where sparkle is as bright as ships.
    If a band has too many bright pixels for ships (`OFTEN`), they are glint and remain. A small sample is not changed.
    """
    inside = list(sample.inside)
    for band in range(0 if _too_small(sample) else len(sample.states[0].raw)):
        high = [s.raw[band] - cv2.blur(s.raw[band], (LOCAL_MEAN,) * 2) for s in sample.states]
        values = sample.values(high)
        limit = FAR_OUT * spread(values)
        if np.percentile(values, OFTEN) <= limit:
            inside = [m & ~grown(plane > limit, 2 * NOT_JUDGED + 1) for m, plane in zip(inside, high, strict=True)]
    return replace(sample, inside=tuple(inside))


def without_shore(sample: Sample) -> Sample:
    """The sample without pixels near land or objects: mixed pixels look like glint that cannot be removed."""
    inside = (m & ~grown(~s.water, 2 * NOT_JUDGED + 1) for s, m in zip(sample.states, sample.inside, strict=True))
    return replace(sample, inside=tuple(inside))


def _without_targets(sample: Sample, runs: Sequence[_Run]) -> tuple[Mask, ...]:
    """Sample mask (row, column) of each tile, without the targets that any candidate found and the pixels around them.
    A recipe that erases targets leaves less texture, and its expected error would be too small.
    """
    inside = list(sample.inside)
    for run in runs:
        for n, found in enumerate(run.targets):
            if found is not None:
                inside[n] = inside[n] & ~grown(np.any(found > 0, axis=0), 2 * NOT_JUDGED + 1)
    return tuple(inside)


def _clear(runs: dict[Candidate, _Run], inside: Sequence[Mask]) -> list[Mask]:
    """Masks of the pixels from which candidate `wiener` removes the least (`least_glint`); [] if it was not run."""
    by_name = {c.name: r.images for c, r in runs.items()}
    if not {"copy", "wiener"} <= by_name.keys():
        return []
    glint = [raw - without for raw, without in zip(by_name["copy"], by_name["wiener"], strict=True)]
    return least_glint(glint, inside)


def _refuse_sky(fitted: FittedChain, unit: Float32) -> None:
    """Raise FitError if a removal subtracts mirrored sky, which varies little, and symmetrically about its median.

    unit : (band,) brightness of the water [unit of the band]; infinite for bands that are not evaluated
    """
    planes = [np.sum(s.removed / unit[:, None, None], axis=0) for s in fitted.sample.states if s.removed is not None]
    taken = fitted.sample.values(planes) / np.isfinite(unit).sum()
    share, deviation = even_share(taken), float(np.std(taken))
    if share > EVEN and deviation < MIRRORED:
        raise FitError(
            f"the removed signal resembles reflected skylight: its standard deviation is {deviation:.1%} of the water, "
            f"and {min(share, 1):.0%} of its variance is symmetric about its median"
        )


def _levels(sample: Sample) -> Float32:
    """Brightness of the water without glint in each band, (band,) [unit of the band]; positive."""
    images = [s.image for s in sample.states]
    dark = np.array([np.percentile(values, WATER_PERCENTILE) for values in sample.values(images)])
    noises = sample.noise_of(images)
    offset = dark < -3 * noises  # the water's brightness was subtracted: take that of the darkest other band
    return np.maximum(np.where(offset, min(dark[~offset], default=0.0), dark), noises).astype(np.float32)
