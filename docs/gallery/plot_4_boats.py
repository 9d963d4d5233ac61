"""
Find boats
==========

After glint is removed, ``detect`` compares each pixel with the water around it and marks what exceeds it.
"""

import cv2
import matplotlib.pyplot as plt
import numpy as np

import deglint
import detect

# %%
# A sample scene of the repository: pixels of 1.24 m, three boats, and objects under water. The reef right of column 150
# is left out.
scene = deglint.open_scene("../../sample_data/sea_1m.tif")
clean = deglint.correct(scene, deglint.fit_scene(scene))[:5, :, :150]

# %%
# ``score_scene`` fits the water and sets a threshold for one false alarm in 10,000 pixels.
found = detect.score_scene(clean, pixel=1.24, pfa=1e-4)
for target in found.objects:
    print("row {row:.0f}, column {column:.0f}, {area_m2:.0f} m2".format(**target))

# %%
# A file beside the scene says where the boats are.
truth = (deglint.open_scene("../../sample_data/sea_1m_cover.tif").read()[:, :, :150] == 3).any(axis=0)
count, labels, _, middles = cv2.connectedComponentsWithStats(truth.astype(np.uint8), connectivity=8)
above = cv2.dilate((found.scores > found.threshold.value).astype(np.uint8), np.ones((5, 5))) > 0
print(sum(above[labels == i].any() for i in range(1, count)), "of", count - 1, "are found")

# %%
# Scores in standard deviations of the water. Circles mark anomalies, crosses the boats. The other large anomalies lie
# under water.
figure, axis = plt.subplots(figsize=(4, 6), layout="constrained")
axis.imshow(np.clip(found.scores, 0, 12), cmap="magma")
axis.plot([o["column"] for o in found.objects], [o["row"] for o in found.objects], "co", ms=14, mfc="none")
axis.plot(middles[1:, 0], middles[1:, 1], "c+")
