"""
Sentinel-2 from a product folder
================================

A product opens by itself: names, wavelengths, scale and offset of the bands come from its files and metadata.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import rasterio

import deglint
from deglint.physics.presets import preset
from deglint.plotting import natural_colour
from deglint.simulate import Bottom, Setup, simulate

# %%
# A small product is made of a simulated reef, so that its truth, the reflectance without sun glint, is known.
sensor, reef, size = preset("sentinel2"), Bottom(depth=(20.0, 3.0), patch=300.0), (192, 192)
sea = simulate(Setup(sensor=sensor, size=size, wind=7.0, sun_zenith=30.0, bottom=reef, seed=4))
factors = np.pi / (sea.light.direct + sea.light.diffuse)[:, None, None]  # from radiance to reflectance
folder, place = Path(tempfile.mkdtemp(suffix="_MSIL2A.SAFE")), rasterio.Affine(10, 0, 600_000, 0, -10, 5_100_000)
(folder / "MTD_MSIL2A.xml").write_text("<Level-2A><Product_Image_Characteristics/></Level-2A>")  # as small as can be
for band, image, factor in zip(sensor.bands, sea.image, factors, strict=True):
    with rasterio.open(folder / f"{band.name}.tif", "w", "GTiff", *size, 1, "EPSG:32630", place, "uint16") as file:
        file.write(np.rint(1e4 * image * sensor.scale(band) * factor).astype(np.uint16), 1)

# %%
# ``open_scene`` takes the folder, a zip of it, or the metadata file. The model says how each band follows the NIR.
scene = deglint.open_scene(folder)
fitted = deglint.fit_scene(scene)
print(fitted.model)
images = scene.read(), deglint.correct(scene, fitted), sea.truth * factors
figure, axis = plt.subplots(figsize=(10, 3.8), layout="constrained")
axis.imshow(np.hstack(natural_colour([image[[2, 1, 0]] for image in images])))
axis.set(title="raw, deglinted, truth", xticks=[], yticks=[])
plt.show()
