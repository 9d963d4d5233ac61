"""
Many scenes and a cluster
=========================

``deglint batch`` runs one recipe over many scenes. A Dask cluster shares out one large scene.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import rioxarray
from dask.distributed import Client

import deglint.xr
from deglint.plotting import natural_colour

# %%
# One command corrects the sample scenes. Given again after an interruption, it does only what is missing.
folder, raw = Path(tempfile.mkdtemp()), [f"../../sample_data/{name}.tif" for name in ("sea_025m", "sea_1m", "sea")]
(folder / "recipe.toml").write_text(f'[output]\ndirectory = "{folder.as_posix()}"\n')
print(subprocess.getoutput(f"{sys.executable} -m deglint batch {folder / 'recipe.toml'} {' '.join(raw)}"))
clean = [folder / f"{Path(file).stem}_deglinted.tif" for file in raw]
figure, axes = plt.subplots(1, 3, figsize=(9, 6), layout="constrained")
for axis, files in zip(axes, zip(raw, clean, strict=True), strict=True):
    images = [deglint.open_scene(file).read(bands=["RED", "GREEN", "BLUE"]) for file in files]
    axis.imshow(np.vstack(natural_colour(images)))
    axis.set(title=f"{Path(files[0]).stem}: raw, deglinted", xticks=[], yticks=[])
plt.show()

# %%
# The workers of a Dask client correct the chunks, and give the same pixels as the command. Here it has two workers of
# this process. ``Client("tcp://10.0.0.5:8786")`` takes those of other machines. rioxarray warns that the scales of the
# bands differ; deglint reads each of them.
with Client(processes=False, n_workers=2, threads_per_worker=1, dashboard_address=None):
    result = deglint.xr.remove(rioxarray.open_rasterio(raw[2], chunks={"x": 96, "y": 96})).compute()
print((result == rioxarray.open_rasterio(clean[2])).all().item())
