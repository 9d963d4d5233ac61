"""
WorldView: bands that are not simultaneous
==========================================

WorldView-3 takes its bands in two sets, 0.3 s apart. Waves move in between, so the two sets see glint at different
places. Each set has a NIR band of its own.
"""

import matplotlib.pyplot as plt
import numpy as np

import deglint
from deglint.plotting import natural_colour

# %%
# A sample scene of the repository: 256 x 256 pixels of 1.24 m, wind 9 m/s, and squares at 5 m depth.
scene = deglint.open_scene("../../sample_data/sea.tif")
truth = deglint.open_scene("../../sample_data/sea_truth.tif").read()
for band in scene.bands:
    print(f"{band.name:8s} {band.wavelength:6.1f} nm  taken at {band.time_offset:.3f} s")

# %%
# The method of Hedley et al. (2005) with one NIR band for all bands, the same method with the NIR band of each set, and
# the default. NIR2 belongs to the set of COASTAL and YELLOW. Errors are in percent of the radiance without glint.
hedley = {"method": "hedley", "compensate": "off"}
recipes = {"one NIR": {"nir": "NIR2", **hedley}, "NIR of each set": hedley, "default": {}}
fitted = {name: deglint.fit_scene(scene, deglint.Recipe(**options)) for name, options in recipes.items()}
images = {"raw": scene.read()} | {name: deglint.correct(scene, fit) for name, fit in fitted.items()} | {"truth": truth}
for name, image in images.items():
    errors = np.sqrt(((image - truth) ** 2).mean(axis=(1, 2)) / (truth**2).mean(axis=(1, 2)))
    print(f"{name:15s}", *(f"  {b.name} {e:.0%}" for b, e in zip(scene.bands[:5], errors, strict=False)))

# %%
figure, axes = plt.subplots(1, 5, figsize=(14, 3.1), layout="constrained")
pictures = natural_colour([image[scene.rgb(range(8))] for image in images.values()])
for axis, title, picture in zip(axes, images, pictures, strict=True):
    axis.imshow(picture)
    axis.set(title=title, xticks=[], yticks=[])
plt.show()
