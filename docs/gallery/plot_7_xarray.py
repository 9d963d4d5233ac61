"""
A time series with xarray
=========================

``dataset.deglint.remove`` takes what odc-stac gives: one variable a band, with a time. Each time is a scene of its own.
Arrays of Dask stay lazy. Mostly an even sheet of glint remains: no image shows how bright it is.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import xarray

import deglint.xr  # registers the accessor
from deglint.physics.presets import preset
from deglint.plotting import natural_colour
from deglint.simulate import Bottom, Setup, simulate

# %%
# One reef on three days with winds of 5, 7 and 9 m/s, as reflectance, and a mask of classes beside the bands.
sensor, reef = preset("sentinel2"), Bottom(depth=(20.0, 3.0), patch=150.0)
sea = Setup(sensor=sensor, size=(96, 96), sun_zenith=30.0, bottom=reef, seed=3)
days = [simulate(replace(sea, wind=wind)) for wind in (5.0, 7.0, 9.0)]
cube = xarray.Dataset(coords={"time": np.array(["2026-06-01", "2026-06-06", "2026-06-11"], "datetime64[ns]")})
truth = cube.copy()
for i, band in enumerate(sensor.bands):
    factor = np.pi / (days[0].light.direct[i] + days[0].light.diffuse[i])  # from radiance to reflectance
    cube[band.name] = ("time", "y", "x"), np.float32([day.image[i] * sensor.scale(band) * factor for day in days])
    truth[band.name] = ("time", "y", "x"), np.float32([day.truth[i] * factor for day in days])
cube["SCL"] = xarray.full_like(cube.B02, 6).astype("uint8")

# %%
# Lazy in, lazy out: corrected pixels are computed when needed. A column for each day: raw, deglinted, and the truth.
clean = cube.chunk({"time": 1, "y": 48}).deglint.remove()
print(clean.B03.data)
rgb = [data[["B04", "B03", "B02"]].to_array().transpose("variable", "y", "time", "x") for data in (cube, clean, truth)]
figure, axis = plt.subplots(figsize=(7, 7), layout="constrained", subplot_kw={"xticks": [], "yticks": []})
axis.imshow(np.vstack(natural_colour([image.values.reshape(3, 96, 288) for image in rgb])))
plt.show()
