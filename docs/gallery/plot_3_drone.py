"""
A drone mosaic over a reef
==========================

Pixels of 8 cm resolve single flashes of sparkle. They hide a reef. ``deglint.xr`` takes an xarray array with
wavelengths and gives one without glint.
"""

import matplotlib.pyplot as plt
import numpy as np
import xarray

import deglint.xr
from deglint.physics.presets import preset
from deglint.plotting import natural_colour
from deglint.simulate import Bottom, Setup, simulate

# %%
# The bottom rises from 15 m to 2 m depth at the edge of a reef. The wind is 5 m/s.
reef = Bottom(depth=(15.0, 2.0), edge=(9.0, 3.0), materials=("sand", "coral"), patch=3.0)
sea = simulate(Setup(sensor=preset("micasense"), size=(256, 256), wind=5.0, sun_zenith=30.0, bottom=reef, seed=5))

# %%
# An array like that of a mosaic of RedEdge bands: radiance, with the wavelengths along ``band``.
bands = sea.setup.sensor.bands
radiance = np.stack([image * sea.setup.sensor.scale(band) for image, band in zip(sea.image, bands, strict=True)])
along = {"band": [b.name for b in bands], "wavelength": ("band", [b.wavelength for b in bands])}
mosaic = xarray.DataArray(radiance.astype(np.float32), dims=("band", "y", "x"), coords=along)
mosaic = mosaic.assign_coords(x=0.08 * np.arange(256), y=-0.08 * np.arange(256)).assign_attrs(crs="EPSG:32610")

# %%
# The choice of the recipe needs the size of a pixel. The CRS says that the coordinates are in metres.
clean = mosaic.deglint.remove()
print(f"error {np.sqrt(((clean.values - sea.truth)[:3] ** 2).mean() / (sea.truth[:3] ** 2).mean()):.1%} of the truth")
figure, axes = plt.subplots(1, 3, figsize=(10, 3.6), layout="constrained")
pictures = natural_colour([image[[2, 1, 0]] for image in (mosaic.values, clean.values, sea.truth)])
for axis, picture, title in zip(axes, pictures, ("raw", "deglinted", "truth"), strict=True):
    axis.imshow(picture)
    axis.set(title=title, xticks=[], yticks=[])
plt.show()
