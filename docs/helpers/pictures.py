"""Pictures of the tutorials: images side by side with one natural-colour stretch."""

import matplotlib.pyplot as plt
import numpy as np


def show(images, truth, bands=(2, 1, 0)):
    """Show (band, row, column) images by their titles, all stretched as `truth`; their error against it is below."""
    bands = list(bands)
    white = 1.2 * np.nanpercentile(truth[bands], 99)
    figure, axes = plt.subplots(1, len(images), figsize=(3.2 * len(images), 3.6), layout="constrained", squeeze=False)
    for axis, (title, image) in zip(axes[0], images.items(), strict=True):
        axis.imshow(np.clip(np.moveaxis(image[bands], 0, 2) / white, 0, 1))
        error = np.sqrt(np.nanmean((image[bands] - truth[bands]) ** 2) / np.nanmean(truth[bands] ** 2))
        axis.set(title=title, xlabel=f"error {error:.1%}" if image is not truth else "", xticks=[], yticks=[])
    return figure
