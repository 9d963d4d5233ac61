"""
Sentinel-2 from a product folder
================================

A product opens by itself: names, wavelengths, scale and offset of the bands come from its metadata. This one is
simulated, so the truth is known.
"""

import tempfile
from pathlib import Path

from pictures import show
from products import reflectance, sentinel2_folder

import deglint
from deglint.physics.presets import preset
from deglint.simulate import Setup, simulate, thesis_array

# %%
# The wind blows with 6 m/s, the sun stands 35 degrees from the zenith. Squares of sand lie at 3 m depth.
shoals = thesis_array((192, 192), 10.0, depth=3.0)
sea = simulate(Setup(sensor=preset("sentinel2"), size=(192, 192), wind=6.0, sun_zenith=35.0, objects=shoals, seed=4))
folder = sentinel2_folder(Path(tempfile.mkdtemp()), sea)

# %%
# ``open_scene`` takes the folder, a zip of it, or the metadata file. It reads no pixel yet.
scene = deglint.open_scene(folder)
print(scene)

# %%
# ``fit_scene`` finds the water and the NIR band and fits how each band follows the glint.
fitted = deglint.fit_scene(scene)
print(fitted.model)

# %%
# ``correct`` gives reflectance without glint. Below each image stands its error relative to the truth.
clean = deglint.correct(scene, fitted)
truth = reflectance(sea, sea.truth)
figure = show({"raw": scene.read(), "truth": truth, "deglinted": clean}, truth)
