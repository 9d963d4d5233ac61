"""
Many scenes and a cluster
=========================

``deglint batch`` runs one recipe over a folder. A Dask cluster shares out one large scene.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import rioxarray
from dask.distributed import Client
from pictures import show

import deglint.xr
from deglint.physics.presets import preset
from deglint.raster.simulated import write_scene
from deglint.simulate import Setup, simulate, thesis_array

# %%
# Three days with more and more wind, a file each.
days, sensor, shoals = Path(tempfile.mkdtemp()), preset("worldview3"), thesis_array((192, 192), 1.24)
for wind in (3, 6, 9):
    write_scene(simulate(Setup(sensor=sensor, size=(192, 192), wind=wind, objects=shoals)), days / f"day{wind}")

# %%
# One command corrects all of them. Given again after an interruption, it does only what is missing.
(days / "recipe.toml").write_text('[output]\ndirectory = "clean"\n')
print(subprocess.getoutput(f"cd {days} && {sys.executable} -m deglint batch recipe.toml 'day?.tif'"))

# %%
# The workers of a Dask client correct the chunks, and give the same pixels as the command. Here it has two workers of
# this process. ``Client("tcp://10.0.0.5:8786")`` takes those of other machines.
with Client(processes=False, n_workers=2, threads_per_worker=1, dashboard_address=None):
    clean = deglint.xr.remove(rioxarray.open_rasterio(days / "day9.tif", chunks={"x": 96, "y": 96})).compute()
print((clean == rioxarray.open_rasterio(days / "clean" / "day9_deglinted.tif")).all().item())
raw, truth, out = (deglint.open_scene(days / f"{f}.tif").read() for f in ("day9", "day9_truth", "clean/day9_deglinted"))
figure = show({"raw": raw, "truth": truth, "deglinted": out}, truth, bands=(4, 2, 1))
