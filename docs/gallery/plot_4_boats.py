"""
Find boats and swimmers
=======================

After glint is removed, ``detect`` compares each pixel with the water around it and marks anomalies.
"""

import cv2
import matplotlib.pyplot as plt
import numpy as np

import deglint
import detect
from deglint.plotting import natural_colour

# %%
# A sample scene of the repository: pixels of 0.25 m, 60 ms from band to band, a boat and five swimmers. A file beside
# it says where they are when each band sees them. A detection may be 4 pixels off. The boat is the largest target.
scene = deglint.open_scene("../../sample_data/sea_025m.tif")
cover = deglint.open_scene("../../sample_data/sea_025m_cover.tif").read()
near = cv2.dilate((cover == 3).any(axis=0).astype(np.uint8), np.ones((9, 9)))
count, labels, boxes, middles = cv2.connectedComponentsWithStats(near)
boat = 1 + np.argmax(boxes[1:, cv2.CC_STAT_AREA])

# %%
# ``score_scene`` searches the visible bands. Its threshold is set for one false alarm in 1,000 pixels. Circles mark
# detections, crosses mark the boat and the swimmers. The swimmer at row 47, column 175 is found in neither image.
images = {"raw": scene.read(), "deglinted": deglint.correct(scene, deglint.fit_scene(scene))}
pictures = natural_colour([image[scene.rgb(range(8))] for image in images.values()])
figure, axes = plt.subplots(1, 2, figsize=(10, 5.2), layout="constrained")
for axis, picture, name in zip(axes, pictures, images, strict=True):
    found = detect.score_scene(images[name][:5], pixel=0.25, pfa=1e-3).objects
    rows, columns = np.array([(target["row"], target["column"]) for target in found]).T
    hits = labels[rows.astype(int), columns.astype(int)]
    swimmers, false = len(set(hits) - {0, boat}), sum(hits == 0)
    print(f"{name}: {swimmers} of {count - 2} swimmers, boat {boat in hits}, {false} false alarms")
    axis.imshow(picture)
    axis.set_title(name)
    axis.plot(columns, rows, "yo", middles[1:, 0], middles[1:, 1], "r+", ms=14, mfc="none")
plt.show()
