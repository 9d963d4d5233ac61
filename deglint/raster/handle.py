"""Open files as one reader holds them: one rasterio dataset a file, put on the scene's grid where needed.

A `Handle` belongs to one thread at a time; `deglint.raster.source` sees to that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..scene import Window
from .convert import Raw, Valid, is_valid
from .flat import FlatField
from .info import RasterInfo, open_dataset


@dataclass(frozen=True)
class FileBands:
    """The bands that one file gives to a scene."""

    path: str  # GDAL name
    indexes: tuple[int, ...]  # 1-based bands of the file, in scene order
    nodatas: tuple[float | None, ...]  # value that says "not valid", one a band
    dataset_mask: bool = False  # the file has one mask for all bands
    band_masks: bool = False  # the file has one mask a band
    alpha: int | None = None  # 1-based alpha band; a pixel where it is 0 is not valid
    flat: FlatField | None = None  # corrects the numbers as they are read
    warp: Mapping[str, Any] | None = field(default=None, repr=False)  # how rasterio's WarpedVRT puts it on the grid

    @classmethod
    def of(cls, info: RasterInfo, nodatas: Sequence[float | None] | None = None) -> FileBands:
        """Every band of one described file; `nodatas` stand in for those of `info`."""
        flags = {flag for flags in info.mask_flags for flag in flags}
        return cls(
            path=info.paths[0],
            indexes=tuple([i for i in range(1, info.count + 2) if i != info.alpha][: info.count]),
            nodatas=tuple(info.nodatas if nodatas is None else nodatas),
            dataset_mask="per_dataset" in flags and "alpha" not in flags,
            band_masks=any(not f for f in info.mask_flags),
            alpha=info.alpha,
            flat=info.flat,
        )


class Handle:
    """The datasets of a scene, open."""

    def __init__(self, files: Sequence[FileBands]) -> None:
        self.files = files
        with ExitStack() as stack:
            self.datasets = [_open(file, stack) for file in files]
            self._stack = stack.pop_all()

    def close(self) -> None:
        """Close the datasets."""
        self._stack.close()

    def read(self, window: Window, bands: Sequence[int], info: RasterInfo, *, nodata: bool) -> tuple[Raw, Valid | None]:
        """Numbers as they stand, (band, row, column), and where they are valid (None: everywhere).

        `nodata` says whether nodata numbers count, or only masks and alpha.
        """
        shape = (len(bands), window[0][1] - window[0][0], window[1][1] - window[1][0])
        if 0 in shape:
            return np.empty(shape, info.dtype), None
        raw, valid, start = np.empty(shape, info.dtype), None, 0
        for file, dataset in zip(self.files, self.datasets, strict=True):
            at = [k for k, b in enumerate(bands) if 0 <= b - start < len(file.indexes)]
            own = [bands[k] - start for k in at]
            start += len(file.indexes)
            if not at:
                continue
            part = np.empty((len(at), *shape[1:]), raw.dtype)
            indexes = [file.indexes[b] for b in own]
            if len({dataset.dtypes[i - 1] for i in indexes}) == 1:
                dataset.read(indexes, window=window, out=part)
            else:  # rasterio reads bands of several types one by one only
                for numbers, i in zip(part, indexes, strict=True):
                    dataset.read(i, window=window, out=numbers)
            known = _validity(file, dataset, part, own, window, nodata)
            if file.flat is not None:
                for numbers, b in zip(part, own, strict=True):
                    file.flat.apply(numbers, window, file.nodatas[b])
            if len(self.files) == 1:
                return part, known
            raw[at] = part
            if known is not None:
                valid = np.ones(raw.shape, np.bool_) if valid is None else valid
                valid[at] = known
        return raw, valid


def _open(file: FileBands, stack: ExitStack) -> Any:
    dataset = open_dataset(file.path)
    stack.callback(dataset.close)  # "with dataset" would tie it to the Env of this thread
    if file.warp is None:
        return dataset
    from rasterio.vrt import WarpedVRT

    warped = WarpedVRT(dataset, **file.warp)
    stack.callback(warped.close)
    return warped


def _validity(file: FileBands, dataset: Any, raw: Raw, bands: list[int], window: Window, nodata: bool) -> Valid | None:
    valid = is_valid(raw, [file.nodatas[b] for b in bands]) if nodata else None
    masks = []
    if file.dataset_mask:
        masks.append(dataset.read_masks(1, window=window)[np.newaxis] != 0)
    elif file.band_masks:
        masks.append(dataset.read_masks([file.indexes[b] for b in bands], window=window) != 0)
    if file.alpha is not None:
        masks.append(dataset.read(file.alpha, window=window)[np.newaxis] != 0)
    for mask in masks:
        if not mask.all():
            valid = np.broadcast_to(mask, raw.shape) if valid is None else valid & mask
    return valid
