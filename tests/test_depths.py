"""The benchmark of depths: its table, its divisions, and that removal does not cost depth."""

import struct

import numpy as np
import pytest

from benchmarks import depths


def test_soundings_are_read_from_dbase(tmp_path):
    fields = b"".join(n.encode().ljust(11, b"\0") + b"N" + bytes(4) + bytes([w]) + bytes(15) for n, w in
                      (("X", 12), ("Y", 12), ("Z", 8), ("NOTE", 5)))  # fmt: skip
    rows = b"".join(f" {x:12.2f}{x + 1:12.2f}{z:8.3f}train".encode() for x, z in ((1.5, 2.25), (3e5, 11.5)))
    head = struct.pack("<4sIHH20x", b"\x03\0\0\0", 2, 32 + len(fields) + 1, 38)
    (tmp_path / "a.dbf").write_bytes(head + fields + b"\r" + rows)
    np.testing.assert_array_equal(depths.soundings(tmp_path / "a.dbf"), [[1.5, 2.5, 2.25], [3e5, 300001, 11.5]])


def test_neighbours_are_left_out_together():
    row, column = np.mgrid[:80, :80].reshape(2, -1)
    square = depths.squares(row, column)
    part = depths.parts(square)
    squares = part.reshape(5, 16, 5, 16).swapaxes(1, 2).reshape(25, -1)
    assert (squares == squares[:, :1]).all()
    assert len(np.unique(part)) == depths.BLOCKS
    columns = np.stack([row, np.ones_like(row)], axis=1).astype(float)
    assert np.sqrt(depths.squared_errors(columns, 2.0 * row + 3, square).max()) < 1e-9


def test_a_difference_has_the_standard_error_of_independent_squares():
    square, raw = np.repeat(np.arange(400), 9), np.ones(3600)
    found = raw + np.repeat(np.random.default_rng(5).normal(0.2, 0.1, 400), 9)  # the same in all of a square
    change, standard_error = depths.difference(found, raw, square)
    assert change == pytest.approx(np.sqrt(1.2) - 1, abs=0.01)
    assert standard_error == pytest.approx(0.1 / 2 / np.sqrt(1.2) / np.sqrt(400), rel=0.1)


@pytest.mark.shared
@pytest.mark.skipif(not depths.FOLDER.exists(), reason="the shared soundings do not lie beside the project")
def test_removal_does_not_cost_depth():
    image = depths.FOLDER / "image.tif"
    raw, depth, row, column = depths.inside(image, depths.soundings(depths.FOLDER / "depth_sample.dbf"))
    clean = depths.removed(image, depths.DEPTH_RECIPES["default"])
    square = depths.squares(row, column)
    before, after = (
        depths.squared_errors(depths.predictors(b[:3, row, column])["log bands"], depth, square).mean()
        for b in (raw, clean)
    )
    assert after <= before
    assert clean[:3, row, column].min() > 0
