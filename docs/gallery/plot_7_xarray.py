"""
A time series with xarray
=========================

``dataset.deglint.remove`` takes what odc-stac gives: one variable a band, with a time. Each time is a scene of its own.
Arrays of Dask stay lazy.
"""

import matplotlib.pyplot as plt
import numpy as np
import xarray

import deglint.xr  # registers the accessor
from deglint import Recipe

# %%
# Three days of one sea with different glint, as reflectance in 1/10,000, and a mask of classes beside the bands.
draw = np.random.default_rng(1)
glint = draw.gamma(0.5, 1.0, (3, 120, 160)) * np.reshape([30, 120, 300], (3, 1, 1))
plume = 150 * np.exp(-(((np.arange(160) - 90) / 18) ** 2))
levels = {"B02": 900, "B03": 700, "B04": 400, "B08": 100}
bands = {b: (("time", "y", "x"), level + glint + plume * (b != "B08")) for b, level in levels.items()}
cube = xarray.Dataset(bands, {"time": np.array(["2026-06-01", "2026-06-06", "2026-06-11"], "datetime64[ns]")})
cube["SCL"] = xarray.full_like(cube.B02, 6).astype("uint8")

# %%
# Lazy in, lazy out: corrected pixels are computed when they are needed.
recipe = Recipe(method="hedley", sample="all", mask="none", compensate="off")
clean = cube.chunk({"y": 60}).deglint.remove(recipe)
print(clean.B03.data)

# %%
figure, axes = plt.subplots(2, 3, figsize=(9, 4.6), layout="constrained", sharex=True, sharey=True)
for column, day in enumerate(cube.time.values):
    for row, data in enumerate((cube, clean)):
        axes[row, column].imshow(data.B03.sel(time=day), vmin=650, vmax=1300)
        axes[row, column].set_title(f"{str(day)[:10]}, {('raw', 'deglinted')[row]}", fontsize=9)
