"""Fit and apply a chain: stages and the removal of glint. Each step is fitted to the result of the steps before it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..remove import GlintModel, apply
from ..remove.predict import glint
from .stages import Chain, apply_stages, fit_stages, parse
from .state import Float32, Sample, Setting, State

FitRemoval = Callable[[Sample, Chain], GlintModel]
"""Function that fits the removal to a sample, given the chain of the stages before it."""


@dataclass(frozen=True, eq=False)
class FittedChain:
    """A fitted chain, the model of its removal, and the sample after all stages."""

    chain: Chain
    model: GlintModel
    sample: Sample


def fit_chain(text: str, sample: Sample, setting: Setting, fit_removal: FitRemoval) -> FittedChain:
    """Fit the stages and the removal of a chain to a sample. `text` is the chain as `parse` reads it, for example
    "remove" (no stages); `fit_removal` fits the removal. Raises FitError if a fit fails, for example because the sample
    is too small, and InputError if `text` is not a chain, or if a stage needs data that `setting` lacks.
    """
    steps = parse(text)
    place = [s.name for s in steps].index("remove")
    before, sample = fit_stages(steps[:place], sample, setting)
    model = fit_removal(sample, Chain(before, (), text))
    sample = replace(sample, states=tuple(removed(s, model) for s in sample.states))
    after, sample = fit_stages(steps[place + 1 :], sample, setting)
    return FittedChain(Chain(before, after, text), model, sample)


def apply_chain(state: State, chain: Chain, model: GlintModel) -> State:
    """Apply the stages `chain.before`, the removal by `model` and the stages `chain.after` to a block with its halo."""
    state = removed(apply_stages(state, chain.before), model)
    return apply_stages(state, chain.after)


def removed(state: State, model: GlintModel) -> State:
    """The state after subtraction of the glint that `model` predicts; `State.removed` is the subtracted glint."""
    if not model.halo:
        image = np.asarray(apply(state.image, model), np.float32)
        return replace(state, image=image, removed=state.image - image)
    amount = np.zeros_like(state.image)
    for band, taken in glint(state.image, model, state.water, state.origin)[0].items():
        amount[band] = taken
    return replace(state, image=state.image - amount, removed=amount)


def with_targets(state: State) -> Float32:
    """Image of a state after all stages, (band, row, column), with the contrast of targets restored."""
    return state.image if state.targets is None else state.image + state.targets
