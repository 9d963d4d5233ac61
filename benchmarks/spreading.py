"""Which spreading of the waves comes nearest to the slopes that Cox and Munk measured? (Thesis, Fig. 4.4.)

    python benchmarks/spreading.py [--wind 9] [--shortest 0.1] [--picture out.png]

Prints the Kullback-Leibler divergence between the slopes of JONSWAP seas (100 km of fetch, Gaussian, waves
down to a length) and the Gram-Charlier density of Cox and Munk, and may draw their densities side by side.
"""

import argparse

import numpy as np

from deglint.physics import slopes
from deglint.physics.waves import Sea, slope_variance

EXPONENTS = (1, 2, 6, 18)
STEP = 0.004
AXIS = np.arange(-1.5, 1.5, STEP) + STEP / 2


def divergence(p, q):
    held = (p > 1e-30) & (q > 1e-300)
    return float((p[held] * np.log(p[held] / q[held])).sum() * STEP**2)


def densities(wind, shortest, convention):
    """Measured density, and those of the seas by exponent, over (upwind, crosswind) slope."""
    up, cross = np.meshgrid(AXIS, AXIS, indexing="ij")
    seas = {s: Sea(wind=wind, spectrum="jonswap", spreading=convention, exponent=s) for s in EXPONENTS}
    drawn = {s: slopes.gaussian(up, cross, *slope_variance(sea, shortest=shortest)) for s, sea in seas.items()}
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


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--wind", type=float, default=9.0)
    parser.add_argument("--shortest", type=float, default=0.1)
    parser.add_argument("--picture")
    given = parser.parse_args()
    print("divergence of the drawn from the measured slopes, and of the measured from the drawn")
    for convention in ("half-angle", "full-angle"):
        measured, drawn = densities(given.wind, given.shortest, convention)
        for s, density in drawn.items():
            there, back = divergence(density, measured), divergence(measured, density)
            print(f"{convention} s={s:<3} {there:7.3f} {back:7.3f}")
        if given.picture and convention == "half-angle":
            draw(given.picture, given.wind, measured, drawn)


if __name__ == "__main__":
    main()
