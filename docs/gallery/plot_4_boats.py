"""
Find boats and swimmers
=======================

After glint is removed, ``detect`` compares each pixel with the water around it and marks what exceeds it.
"""

import matplotlib.pyplot as plt
import numpy as np

import deglint
import detect

# %%
# The sample scene, deglinted, with three boats and two swimmers put in: rows, columns, radiance added.
scene = deglint.open_scene("../../sample_data/sea.tif")
clean = deglint.correct(scene, deglint.fit_scene(scene))[:5].copy()
targets = {"boat 1": (40, 60, 3, 9), "boat 2": (120, 40, 2, 5), "boat 3": (200, 100, 3, 7),
           "swimmer 1": (80, 100, 1, 1), "swimmer 2": (160, 90, 1, 1)}  # fmt: skip
for row, column, high, wide in targets.values():
    clean[:, row : row + high, column : column + wide] += 0.03

# %%
# ``score_scene`` fits the water around and sets a threshold for one false alarm in 10,000 pixels.
found = detect.score_scene(clean, pixel=1.24, pfa=1e-4)
for target in found.objects[:8]:
    print("row {row:5.1f}  column {column:5.1f}  {area_m2:5.1f} m2  score {score:6.1f}".format(**target))

# %%
# The scores in standard deviations of the water around; circles mark what exceeds the threshold.
figure, axis = plt.subplots(figsize=(5, 5), layout="constrained")
axis.imshow(np.clip(found.scores, 0, 12), cmap="magma")
axis.scatter([o["column"] for o in found.objects], [o["row"] for o in found.objects], 300, "none", edgecolors="cyan")
for name, (row, column, _, _) in targets.items():
    axis.annotate(name, (column, row), (8, 8), textcoords="offset points", color="white")
axis.set(xticks=[], yticks=[])

# %%
# RX, the squared Mahalanobis distance from all of the image, in one line.
print("highest RX score:", float(np.nanmax(detect.rx(clean))))
