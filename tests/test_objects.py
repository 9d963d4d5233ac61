"""Objects: counts and places against brute force, outlines drawn back to the same pixels, GeoJSON as others read it."""

import json
import math
from collections import deque
from itertools import pairwise

import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rasterio.features import rasterize

from deglint.errors import InputError
from detect.objects import find, to_geojson
from detect.pipeline import Recipe

from .common import PLACE

MASKS = arrays(np.bool_, st.tuples(st.integers(1, 9), st.integers(1, 9)))


def brute_parts(mask, reach2):
    """Sets of pixels that are joined by steps of squared length up to reach2."""
    left = {tuple(p) for p in np.argwhere(mask).tolist()}
    parts = []
    while left:
        start = left.pop()
        part, waiting = {start}, deque([start])
        while waiting:
            r, c = waiting.popleft()
            near = {p for p in left if (p[0] - r) ** 2 + (p[1] - c) ** 2 <= reach2}
            left -= near
            part |= near
            waiting.extend(near)
        parts.append(frozenset(part))
    return set(parts)


def pixels(found):
    (top, _), (left, _) = found.bounds
    return frozenset((int(r) + top, int(c) + left) for r, c in np.argwhere(found.footprint))


@given(MASKS, st.sampled_from([(0.0, 2), (2.0, 4), (2.9, 8), (1.2, 2), (4.2, 17)]))
def test_parts_are_those_of_brute_force(mask, case):
    distance, reach2 = case
    scores = np.random.default_rng(mask.size).random(mask.shape)
    found = find(mask, scores, merge_distance=distance)
    assert {pixels(o) for o in found} == brute_parts(mask, reach2)


def test_pixels_that_a_masked_array_hides_are_in_no_object():
    scores = np.ma.masked_greater(np.array([[9.0, 1, 1, 99], [7, 1, 1, 8]]), 50)
    for mask in (scores > 2, scores.data > 2):
        assert [(o.size, o.score_max) for o in find(mask, scores)] == [(2, 9), (1, 8)]


@given(MASKS)
def test_numbers_are_those_of_the_pixels(mask):
    scores = np.random.default_rng(mask.size).integers(0, 5, mask.shape).astype(np.float32)
    found = find(mask, scores, pixel_area=4.0)
    assert [o.label for o in found] == list(range(1, len(found) + 1))
    assert all(a.score_max >= b.score_max for a, b in pairwise(found))
    for o in found:
        at = np.array(sorted(pixels(o)))
        values = scores[at[:, 0], at[:, 1]]
        assert (o.size, o.area, o.score_max) == (len(at), 4.0 * len(at), values.max())
        assert o.score_mean == pytest.approx(values.mean())
        assert o.centroid == pytest.approx(at.mean(axis=0))
        assert o.bounds == tuple(zip(at.min(axis=0).tolist(), (at.max(axis=0) + 1).tolist(), strict=True))


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(arrays(np.bool_, st.tuples(st.integers(1, 12), st.integers(1, 12))))
def test_outlines_are_simple_rings_that_draw_back_to_the_pixels(mask):
    drawn = np.zeros(mask.shape, int)
    for polygon in (p for o in find(mask, mask.astype(float)) for p in o.outline):
        for ring in polygon:
            assert ring[0] == ring[-1]
            assert len(set(ring)) == len(ring) - 1 >= 4
        inside = rasterize([{"type": "Polygon", "coordinates": polygon}], mask.shape)
        outer, *holes = (abs(sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise(ring))) / 2 for ring in polygon)
        assert outer - sum(holes) == inside.sum()
        drawn += inside
    np.testing.assert_array_equal(drawn, mask)


def test_small_objects_are_dropped_after_merging():
    mask = np.array([[1, 0, 1, 0, 0, 0, 1]], bool)
    scores = np.arange(7.0)[None]
    assert [o.size for o in find(mask, scores, min_size=2)] == []
    assert [o.size for o in find(mask, scores, min_size=2, merge_distance=2)] == [2]
    assert [o.label for o in find(mask, scores, min_size=1)] == [1, 2, 3]


def test_nan_and_nothing_are_no_objects():
    mask = np.ones((2, 3), bool)
    scores = np.full((2, 3), np.nan)
    assert find(mask, scores) == []
    scores[0, 0] = 5
    assert [o.size for o in find(mask, scores)] == [1]
    assert find(~mask, scores) == []
    assert find(np.zeros((0, 4), bool), np.zeros((0, 4))) == []


def test_inputs_are_left_alone():
    mask = np.ones((3, 3), np.uint8)
    scores = np.eye(3)
    mask.flags.writeable = scores.flags.writeable = False
    assert len(find(mask, scores)) == 1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"min_size": 0}, "min_size: want a number from 1"),
        ({"merge_distance": -1}, "merge_distance: want a number from 0"),
        ({"merge_distance": float("nan")}, "merge_distance: want a number from 0"),
    ],
)
def test_options_out_of_range(options, said):
    with pytest.raises(InputError, match=said):
        find(np.ones((2, 2), bool), np.ones((2, 2)), **options)
    with pytest.raises(InputError, match=said):  # before the scene is scored
        Recipe(**options)


def test_shapes_must_agree():
    with pytest.raises(InputError, match="one shape"):
        find(np.ones((2, 2), bool), np.ones((2, 3)))


def test_geojson_lies_where_the_pixels_lie(tmp_path):
    mask = np.zeros((40, 50), bool)
    mask[3:9, 4:12] = True
    mask[5:7, 6:8] = False  # a hole
    mask[9, 12] = True  # touches at a corner: a second polygon
    mask[30, 40] = True
    scores = np.random.default_rng(0).random(mask.shape).astype(np.float32)
    transform = PLACE["transform"]
    found = find(mask, scores, pixel_area=100.0)
    document = to_geojson(found, lambda ring: [transform * p for p in ring])
    path = tmp_path / "found.geojson"
    path.write_text(json.dumps(document, allow_nan=False))
    kinds = sorted(f["geometry"]["type"] for f in document["features"])
    assert kinds == ["MultiPolygon", "Polygon"]
    properties = document["features"][0]["properties"]
    assert properties["area_m2"] == 100 * properties["pixels"]
    back = rasterize([f["geometry"] for f in document["features"]], mask.shape, transform=transform)
    np.testing.assert_array_equal(back, mask)
    ring = next(f for f in document["features"] if f["geometry"]["type"] == "Polygon")["geometry"]["coordinates"][0]
    turn = sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise(ring))
    assert turn > 0  # counter-clockwise
    assert (min(p[0] for p in ring), max(p[1] for p in ring)) == (400_400, 799_700)


def test_no_crs_keeps_pixel_corners():
    document = to_geojson(find(np.ones((1, 2), bool), np.ones((1, 2))))
    ring = document["features"][0]["geometry"]["coordinates"][0]
    assert sorted({tuple(p) for p in ring}) == [(0, 0), (0, 1), (2, 0), (2, 1)]
    assert rasterio.features.bounds(document) == (0, 0, 2, 1)


def test_a_single_pixel_is_weaker_than_a_hull_of_the_same_peak() -> None:
    scores = np.array([[9.0, 0, 9, 8, 7], [0, 0, 0, 6, 0]])
    single, hull = sorted(find(scores > 2, scores), key=lambda o: o.size)
    assert hull.score_top == pytest.approx(math.sqrt((81 + 64 + 49) / 3))
    assert single.score_top == pytest.approx(9 / math.sqrt(3))
