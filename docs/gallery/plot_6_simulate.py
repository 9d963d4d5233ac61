"""
Simulate and score
==================

Which method leaves the least error? A simulated scene has its truth beside it, so that errors can be measured.
"""

import matplotlib.pyplot as plt
import numpy as np

import deglint
from deglint.physics.presets import preset
from deglint.plotting import natural_colour
from deglint.simulate import Setup, simulate, thesis_array

# %%
# Squares of 2, 5, 10 and 20 % reflectance at 5 m depth under 5 m/s of wind; pixels of 0.25 m, and no band delay.
sensor = preset("thesis").delayed(0.0)
squares = thesis_array((192, 192), sensor.gsd)
sea = simulate(Setup(sensor=sensor, size=(192, 192), wind=5.0, objects=squares, seed=7))
radiance = sea.image * np.reshape([sensor.scale(band) for band in sensor.bands], (-1, 1, 1))

# %%
# ``fit`` and ``apply`` work on plain arrays. Bands are counted from 0; band 6 is the NIR.
clean = {}
for method in ("hedley", "lyzenga", "joyce"):
    model = deglint.fit(method, radiance, nir=6)
    clean[method] = deglint.apply(radiance, model)
    error = np.sqrt(((clean[method] - sea.truth)[:5] ** 2).mean() / (sea.truth[:5] ** 2).mean())
    print(f"{method:8s} error {error:.2%} of the truth")

# %%
figure, axes = plt.subplots(1, 3, figsize=(10, 3.6), layout="constrained")
pictures = natural_colour([image[[4, 2, 1]] for image in (radiance, clean["hedley"], sea.truth)])
for axis, picture, title in zip(axes, pictures, ("raw", "hedley", "truth"), strict=True):
    axis.imshow(picture)
    axis.set(title=title, xticks=[], yticks=[])
plt.show()
