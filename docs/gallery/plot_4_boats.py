"""
Find boats and swimmers
=======================

After glint is removed, ``detect`` compares each pixel with the water around it and marks what exceeds it.
"""

import cv2
import matplotlib.pyplot as plt
import numpy as np

import deglint
import detect

# %%
# A sample scene of the repository: pixels of 0.25 m, a boat with its wake, five swimmers, and objects under water. The
# reef right of column 200 is left out.
scene = deglint.open_scene("../../sample_data/sea_025m.tif")
clean = deglint.correct(scene, deglint.fit_scene(scene))[:5, :, :200]

# %%
# ``score_scene`` fits the water and sets a threshold for one false alarm in 10,000 pixels.
found = detect.score_scene(clean, pixel=0.25, pfa=1e-4)
for target in found.objects[:6]:
    print("row {row:5.1f}  column {column:5.1f}  {area_m2:5.1f} m2  score {score:6.1f}".format(**target))

# %%
# A file beside the scene says where the boat and the swimmers are. White swimmers look like sparkle, and are lost.
truth = (deglint.open_scene("../../sample_data/sea_025m_cover.tif").read()[:, :, :200] == 3).any(axis=0)
count, labels, _, middles = cv2.connectedComponentsWithStats(truth.astype(np.uint8), connectivity=8)
above = cv2.dilate((found.scores > found.threshold.value).astype(np.uint8), np.ones((5, 5))) > 0
print(sum(above[labels == i].any() for i in range(1, count)), "of", count - 1, "are found")

# %%
# Scores in standard deviations of the water. Circles mark anomalies, crosses the boat and the swimmers.
figure, axis = plt.subplots(figsize=(4, 6), layout="constrained")
axis.imshow(np.clip(found.scores, 0, 12), cmap="magma")
axis.scatter([o["column"] for o in found.objects], [o["row"] for o in found.objects], 200, "none", edgecolors="cyan")
axis.plot(middles[1:, 0], middles[1:, 1], "c+")
