"""Stand-in until the real table lands."""
from __future__ import annotations
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any
from . import background, sharpen
from .state import State, Sample, Setting
class ReplaceLevel:
    name = "replace-level"; halo = 0
    def apply(self, state): return background.replace_glint(state)
class NoTargets:
    name = "targets"; halo = 0
    def apply(self, state): return state
class Posterior:
    name = "posterior"
    def __init__(self, bands, curves, sigma, width):
        self.bands, self.curves, self.sigma, self.width = bands, curves, sigma, width
    @property
    def halo(self): return 12 * self.width
    def apply(self, state):
        from dataclasses import replace
        import numpy as np
        from .posterior import posterior
        image = state.image.copy()
        for b in self.bands:
            q, v = self.curves[b]
            g = np.maximum(state.removed[b], 0)
            V = (np.interp(g, q, v) * np.maximum(g / max(q[-1], 1e-9), 1) ** 2).astype("f4")
            image[b], _ = posterior(state.image[b], V, self.sigma[b], self.width)
        return replace(state, image=image)
def fit_posterior(sample, setting, number=None):
    import cv2, numpy as np
    from .posterior import left_over
    from .noise import noise, clump_width
    bands = [b for b in range(len(setting.bands)) if any(s.removed[b].any() for s in sample.states)]
    width = min(max(clump_width(sample, setting.nir[0]), 3), 8)
    curves, sigma = {}, {}
    for b in bands:
        ys = [s.image[b] for s in sample.states]
        sigma[b] = min(noise([s.raw[b] for s in sample.states], sample.inside), noise(ys, sample.inside))
        curves[b] = left_over([y - cv2.medianBlur(y, 5) for y in ys], [np.maximum(s.removed[b], 0) for s in sample.states], sample.inside, sigma[b])
    return Posterior(bands, curves, sigma, width)
STAGES = {"psf": SimpleNamespace(fit=sharpen.fit), "identify-level": SimpleNamespace(fit=background.fit), "replace-level": SimpleNamespace(fit=lambda *a: ReplaceLevel()), "posterior": SimpleNamespace(fit=fit_posterior), "remove": None, "targets": SimpleNamespace(fit=lambda *a: NoTargets())}
@dataclass(frozen=True)
class Step:
    name: str
    number: float | None = None
def parse(text):
    steps = []
    for p in text.split(","):
        n, _, k = p.strip().partition(":")
        steps.append(Step(n, float(k) if k else None))
    if all(s.name != "remove" for s in steps): steps.append(Step("remove"))
    return tuple(steps)
@dataclass(frozen=True)
class Chain:
    before: tuple = ()
    after: tuple = ()
    text: str = ""
    @property
    def runs(self): return bool(self.before or self.after)
    @property
    def halo(self): return sum(s.halo for s in (*self.before, *self.after))
    @property
    def replaces(self): return any(s.name.startswith('replace') for s in self.before + self.after)
    def numbers(self): return {"chain": self.text}

def chain_from(data):
    raise NotImplementedError
