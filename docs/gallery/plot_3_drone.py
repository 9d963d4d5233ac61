"""
A drone mosaic over a reef
==========================

Pixels of 8 cm resolve single flashes. They hide a reef at 2 m depth. ``deglint.xr`` takes an xarray array with
wavelengths and gives one without glint.
"""

import numpy as np
import xarray
from pictures import show

import deglint.xr
from deglint.physics.presets import preset
from deglint.simulate import Setup, SubmergedObject, simulate

# %%
# The reef: patches of irregular outline and different brightness.
draw = np.random.default_rng(2)
reef = []
for brightness in draw.uniform(0.05, 0.25, 24):
    turn, radius = np.linspace(0, 2 * np.pi, 9)[:-1], draw.uniform(0.5, 1.6) * draw.uniform(0.7, 1.3, 8)
    corners = draw.uniform([9.5, 2.5], [17.5, 17.5]) + np.stack([radius * np.cos(turn), radius * np.sin(turn)], 1)
    reef.append(SubmergedObject(corners=tuple(map(tuple, corners)), reflectance=brightness, depth=2.0))
sea = simulate(Setup(sensor=preset("micasense"), size=(256, 256), wind=4.0, objects=tuple(reef), seed=5))

# %%
# An array like that of a mosaic of RedEdge bands: radiance, with the wavelengths along ``band``.
bands = sea.setup.sensor.bands
radiance = np.stack([image * sea.setup.sensor.scale(band) for image, band in zip(sea.image, bands, strict=True)])
along = {"band": [b.name for b in bands], "wavelength": ("band", [b.wavelength for b in bands])}
mosaic = xarray.DataArray(radiance.astype(np.float32), dims=("band", "y", "x"), coords=along)
mosaic = mosaic.assign_coords(x=0.08 * np.arange(256), y=-0.08 * np.arange(256)).assign_attrs(crs="EPSG:32610")

# %%
# Where the bottom shows, state a sample of deep water (column, row, width, height); else the fit includes the reef.
clean = mosaic.deglint.remove(deglint.Recipe(sample="0,0,80,256"))
figure = show({"raw": mosaic.values, "truth": sea.truth, "deglinted": clean.values}, sea.truth)
