"""Which spreading of the waves comes nearest to the slopes that Cox and Munk measured? (Thesis, Fig. 4.4.)

    python -m benchmarks spreading [--wind 9] [--docs]

Prints the Kullback-Leibler divergence between the slopes of JONSWAP seas (100 km of fetch, Gaussian, waves
down to 10 cm) and the Gram-Charlier density of Cox and Munk; with --docs, draws their densities side by side.
"""

import numpy as np

from deglint.physics import slopes
from deglint.physics.waves import Sea, slope_variance

from .timing import ROOT

EXPONENTS = (1, 2, 6, 18)
SHORTEST = 0.1  # wave of the seas [m]
SLOPE_STEP = 0.004
AXIS = np.arange(-1.5, 1.5, SLOPE_STEP) + SLOPE_STEP / 2


def divergence(p, q):
    held = (p > 1e-30) & (q > 1e-300)
    return float((p[held] * np.log(p[held] / q[held])).sum() * SLOPE_STEP**2)


def densities(wind, convention):
    """Density of slopes (upwind, crosswind) by Cox and Munk, and those of the seas, by exponent."""
    up, cross = np.meshgrid(AXIS, AXIS, indexing="ij")
    seas = {s: Sea(wind=wind, spectrum="jonswap", spreading=convention, exponent=s) for s in EXPONENTS}
    drawn = {s: slopes.gaussian(up, cross, *slope_variance(sea, shortest=SHORTEST)) for s, sea in seas.items()}
    return slopes.density(up, cross, wind), drawn


def draw(path, wind, measured, drawn):
    import matplotlib.pyplot as plt

    panels = {"Cox and Munk": measured}
    panels |= {f"s = {s}: {divergence(p, measured):.3f}": p for s, p in drawn.items()}
    figure, axes = plt.subplots(1, len(panels), figsize=(2.6 * len(panels), 3.4), sharey=True, layout="constrained")
    for ax, (title, density) in zip(axes, panels.items(), strict=True):
        ax.contour(AXIS, AXIS, density, levels=density.max() * np.array([0.03, 0.1, 0.3, 0.6, 0.9]))
        ax.set(title=title, xlim=(-0.6, 0.6), ylim=(-0.6, 0.6), xlabel="crosswind slope", aspect="equal")
    axes[0].set_ylabel("upwind slope")
    figure.suptitle(f"Slopes at {wind:g} m/s, and divergence from those measured")
    figure.savefig(path, dpi=110)


def main(wind, docs):
    print("divergence of the drawn from the measured slopes, and of the measured from the drawn")
    for convention in ("half-angle", "full-angle"):
        measured, drawn = densities(wind, convention)
        for s, density in drawn.items():
            there, back = divergence(density, measured), divergence(measured, density)
            print(f"{convention} s={s:<3} {there:7.3f} {back:7.3f}")
        if docs and convention == "half-angle":
            draw(ROOT / "docs" / "spreading.png", wind, measured, drawn)
