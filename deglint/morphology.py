"""Masks grown and opened by a square."""

import numpy as np
import numpy.typing as npt

__all__ = ["grown", "opened", "square"]


def square(side: int) -> npt.NDArray[np.uint8]:
    """A square structuring element."""
    return np.ones((side, side), np.uint8)


def grown(mask: npt.NDArray[np.bool_], side: int) -> npt.NDArray[np.bool_]:
    """The mask, dilated by a square of this side."""
    import cv2

    return np.asarray(cv2.dilate(mask.view(np.uint8), square(side))).view(np.bool_)


def opened(mask: npt.NDArray[np.bool_], side: int) -> npt.NDArray[np.bool_]:
    """The pixels of a mask that lie in squares of this side inside it."""
    import cv2

    return np.asarray(cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_OPEN, square(side))).view(np.bool_)
