"""What passes from stage to stage of a compensation: the image so far, and what the stages have found out about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..scene import FloatArray, Window
from .psf import PSF

Float32Array = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]
LIMITS = 7
"""Numbers that tell of a band what is glint, see `State.limits`."""


@dataclass(eq=False)
class State:
    """A block of a scene on its way through a chain.

    Attributes
    ----------
    image : (band, row, column) float32 ndarray
        The image so far, NaN where not valid; stages write into it.
    where : (row, column) bool ndarray, optional
        Pixels that may be changed; all where None.
    units : (band,) float64 ndarray
        What `image` is to be multiplied with to be in the scene's unit again.
    sharp : callable, optional
        Gives the rows and columns asked for of a sharpened band, named by its number, for the level alone.
    psfs : sequence of PSF, optional
        What the bands were sharpened with, so that a level of sharpened bands can be blurred again.
    opened : Opened, optional
        Openings (`deglint.compensate.level`) that the level is yet to be made of.
    water : (band, row, column) float32 ndarray, optional
        The last level that glint was replaced by: of the water beside the sparkle.
    limits : (band, LIMITS) float32 ndarray, optional
        What is still to be added to the level, by how much glint exceeds that, and where a band is full; the level of
        water, above which the first two grow, by what share of themselves per unit, and by what share at most; and by
        what share of that height glint must exceed the level more.
    outlined : (row, column) bool ndarray, optional
        Where an opening has found outlines of things: later ones look for them nowhere else.
    sound : bool
        Every number of the image is known to be finite; stages leave it so.
    lent : bool
        The image is another's, or a part of one: it is not written, see `take`.
    keep : bool
        The level is wanted after glint was replaced.
    spare : (int, int, int, int)
        Rows above and below, columns left and right, that may be cut off: nothing after the stage looks at them.
    """

    image: Float32Array
    where: Mask | None = None
    units: npt.NDArray[np.float64] = field(default_factory=lambda: np.ones(0))
    sharp: Callable[[int, Window], Float32Array] | None = None
    psfs: tuple[PSF, ...] | None = None
    opened: Any = None
    _level: Float32Array | None = None
    water: Float32Array | None = None
    limits: Float32Array | None = None
    _hit: Mask | None = None
    _replaced: Mask | None = None
    outlined: Mask | None = None
    sound: bool = False
    lent: bool = False
    keep: bool = True
    spare: tuple[int, int, int, int] = (0, 0, 0, 0)

    def __post_init__(self) -> None:
        if not self.units.size:
            self.units = np.ones(len(self.image))

    @classmethod
    def of(cls, block: FloatArray, where: Mask | None = None) -> State:
        """A state for a block, which is copied."""
        return cls(_single(block), where)

    @classmethod
    def own(cls, block: FloatArray) -> State:
        """A state that works on the block itself where that is float32, and on a copy elsewhere."""
        return cls(block if block.dtype == np.float32 and block.flags.writeable else _single(block))

    @classmethod
    def on(cls, block: FloatArray) -> State:
        """A state that leaves the block as it is, and copies it only where it has to."""
        return cls(block, lent=True) if block.dtype == np.float32 else cls(_single(block))

    def take(self) -> None:
        """Make the image one that may be written."""
        if self.lent:
            self.image, self.lent = self.image.copy(), False

    @property
    def level(self) -> Float32Array | None:
        """What the bands would be without glint, where that is known, (band, row, column)."""
        if self.opened is not None:
            (self._level, found), self.opened = self.opened.of_image(len(self.image)), None
            self.outlined = self.outlined if found is None else found
        return self._level

    @level.setter
    def level(self, found: Float32Array | None) -> None:
        self._level, self.opened = found, None

    @property
    def replaced(self) -> Mask:
        """What has been replaced, (band, row, column)."""
        if self._replaced is None:
            self._replaced = np.zeros(self.image.shape, np.bool_)
        return self._replaced

    @property
    def hit(self) -> Mask | None:
        """Identified glint that is not replaced yet, (band, row, column)."""
        self.mark()
        return self._hit

    @hit.setter
    def hit(self, found: Mask | None) -> None:
        self._hit, self.limits = found, None

    def found(self, level: Any, limits: Float32Array) -> None:
        """A level, or openings that it is made of, and what exceeds it is glint."""
        if isinstance(level, np.ndarray):
            self.level = level
        else:
            self._level, self.opened = None, level
        self._hit, self.limits = None, limits

    def mark(self) -> None:
        """Mark what exceeds the level, where that is still to be done: before the image or the level change."""
        from ._level_kernels import mark

        if self.limits is None or self.level is None:
            return
        self.take()
        self._hit = np.empty(self.image.shape, np.bool_)
        for b, limits in enumerate(self.limits):
            mark(self.image[b], tuple(limits), self.level[b], self._hit[b])
        if self.where is not None:
            self._hit &= self.where
        self.limits = None

    def settle(self) -> None:
        """Put the level where there is glint."""
        from ._level_kernels import settle
        from .glance import block

        at_once = self.limits is not None and self.where is None and self._replaced is None
        if self.opened is not None and self.opened.fits and at_once:
            self.level, self.image, self._replaced, outlined = self.opened.settled(self.image, self.limits, self.keep)
            self.outlined = self.outlined if outlined is None else outlined
            self.limits, self.lent = None, False
            return
        assert self.level is not None
        if self.limits is None:
            if self._hit is not None:
                self.replace(self._hit, self.level)
            return
        may = np.empty((0, 0), np.bool_) if self.where is None else self.where
        clean = np.empty(self.image.shape, np.float32)
        settle(block(self.image), self.limits, may, self.level, self.replaced, clean)
        self.image, self.lent, self.limits = clean, False, None

    def replace(self, hit: Mask, values: Float32Array) -> None:
        """Put values where there is glint."""
        from ._level_kernels import put_all

        self.take()
        put_all(values, hit, self.image, self.replaced)

    def inner(self, reach: int = 0) -> Window:
        """Rows and columns that are left once the spare ones are cut off, but for `reach` of them on every side."""
        top, bottom, left, right = (max(n - reach, 0) for n in self.spare)
        return (top, self.image.shape[1] - bottom), (left, self.image.shape[2] - right)

    def hand_over(self) -> Float32Array:
        """The image, which is forgotten here with all else, so that no memory is held that nobody looks at again."""
        image, nothing = self.image, State(np.empty((0, 0, 0), np.float32))
        vars(self).update(vars(nothing))
        return image

    def cut(self) -> None:
        """Cut off what is spare; the block itself is left as it is."""
        if not any(self.spare):
            return
        rows, columns = self.inner()
        at = slice(*rows), slice(*columns)
        if self.sharp is not None:
            self.sharp = _moved(self.sharp, rows[0], columns[0])
        self.image, self.lent = self.image[(..., *at)], True
        for name in ("where", "_level", "water", "_hit", "_replaced", "outlined"):
            value = getattr(self, name)
            if value is not None:
                setattr(self, name, np.ascontiguousarray(value[(..., *at)]))
        self.spare = (0, 0, 0, 0)


def _moved(sharp: Callable[[int, Window], Float32Array], top: int, left: int) -> Callable[[int, Window], Float32Array]:
    """The same for rows and columns that are counted from elsewhere."""
    return lambda band, at: sharp(band, ((at[0][0] + top, at[0][1] + top), (at[1][0] + left, at[1][1] + left)))


def _single(block: FloatArray) -> Float32Array:
    """A copy in float32, in which stages compute.

    Raises
    ------
    InputError
        A number is beyond it.
    """
    try:
        with np.errstate(over="raise"):
            return np.array(block, np.float32)
    except FloatingPointError as error:
        largest = float(np.nanmax(np.abs(block)))
        raise InputError(
            f"numbers reach {largest:.3g}, and compensation computes in float32, up to 3.4e+38. Bring them to other "
            "units, mark what is not valid as nodata, or compensate off."
        ) from error
