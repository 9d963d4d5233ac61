"""Morphological dilation and opening of masks by a square."""

import numpy as np
import numpy.typing as npt


def square(side: int) -> npt.NDArray[np.uint8]:
    """A square structuring element: ones, (side, side)."""
    return np.ones((side, side), np.uint8)


def grown(mask: npt.NDArray[np.bool_], side: int) -> npt.NDArray[np.bool_]:
    """The mask (row, column), dilated by a square of `side` x `side` pixels."""
    import cv2

    return np.asarray(cv2.dilate(mask.view(np.uint8), square(side))).view(np.bool_)


def opened(mask: npt.NDArray[np.bool_], side: int) -> npt.NDArray[np.bool_]:
    """The mask (row, column), opened: True in all squares of `side` x `side` pixels that the mask covers completely."""
    import cv2

    return np.asarray(cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_OPEN, square(side))).view(np.bool_)
