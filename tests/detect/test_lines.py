"""Lines scored as they come."""

import json

import numpy as np
import pytest
import rasterio

from deglint.errors import InputError
from detect import LineScorer, rx, score_lines

from ..common import says


def test_scores_follow_the_background_and_never_the_line_itself():
    rng = np.random.default_rng(0)
    drift = np.linspace(0, 300, 400)[:, None, None]
    lines = rng.normal(0, 3, (400, 4, 256)) @ np.eye(256) + 100 + drift
    lines[300, ::2, 100:104] += 60
    scores = np.stack(list(score_lines(lines, memory=16)))
    assert np.isfinite(scores[1:]).all()
    assert np.median(scores[50:]) == pytest.approx(3.36, rel=0.2)  # chi-squared with 4 degrees of freedom
    assert scores[300, 100:104].min() > 100 > 3 * np.quantile(scores[301:], 0.99)
    later = lines.copy()
    later[350:] = 0
    np.testing.assert_array_equal(np.stack(list(score_lines(later, memory=16)))[:350], scores[:350])


def test_an_even_sea_gives_what_rx_gives():
    lines = np.random.default_rng(1).normal(50, 2, (300, 3, 200))
    scores = np.stack(list(score_lines(lines, memory=10_000)))
    np.testing.assert_allclose(scores[250:], rx(lines.swapaxes(0, 1))[250:], rtol=0.1, atol=0.1)


def test_invalid_pixels_have_no_score_and_teach_nothing():
    lines = np.random.default_rng(2).normal(50, 2, (50, 3, 100))
    lines[:, :, :10] = np.nan
    scores = np.stack(list(score_lines(lines)))
    assert np.isnan(scores[:, :10]).all()
    np.testing.assert_allclose(scores[5:, 10:], np.stack(list(score_lines(lines[:, :, 10:])))[5:], rtol=1e-6)
    masked = np.ma.masked_equal(np.nan_to_num(lines, nan=-9999), -9999)
    np.testing.assert_array_equal(np.stack(list(score_lines(masked))), scores)


def test_a_new_background_is_learnt():
    lines = np.random.default_rng(4).normal(50, 2, (200, 3, 100))
    lines[100:] += np.array([100, -20, 60])[:, None]
    scores = np.stack(list(score_lines(lines, memory=16)))
    assert scores[100].min() > 100
    assert np.median(scores[190:]) < 10


def test_wrong_lines_and_numbers_are_refused():
    scorer = LineScorer()
    scorer.score(np.zeros((3, 5)))
    with pytest.raises(InputError, match="always of the same bands"):
        scorer.score(np.zeros((4, 5)))
    with pytest.raises(InputError, match="1 or more"):
        LineScorer(0)
    with pytest.raises(InputError, match="1 or more"):
        LineScorer(np.nan)
    with pytest.raises(InputError, match="beyond double precision"):
        scorer.score(np.full((3, 5), 1e200))


def test_a_scene_of_one_line_is_told_to_be_too_short(rxdetect, write, tmp_path):
    source = write(tmp_path / "line.tif", np.random.default_rng(0).normal(50, 2, (3, 1, 90)).astype(np.float32))
    ran = rxdetect("score", source, tmp_path / "s.tif", "--lines")
    assert ran.code == 3
    assert says(ran.err, "no line", "4 valid pixels")
    assert "is nodata" not in ran.err


@pytest.mark.filterwarnings("error")
def test_a_score_beyond_float32_is_its_largest_value():
    scorer, lines = LineScorer(), np.random.default_rng(4).normal(50, 2, (30, 3, 100))
    lines[20, 0, 7] = 1e30
    scores = np.stack([scorer.score(line) for line in lines])
    assert scores[20, 7] == np.finfo(np.float32).max
    assert scores[20:].max(initial=0, where=np.arange(100) != 7) < 100


def test_the_command_scores_line_by_line(rxdetect, write, tmp_path, monkeypatch):
    lines = np.random.default_rng(3).normal(500, 5, (300, 3, 80))
    lines[200, :, 40:42] += 200
    image = lines.swapaxes(0, 1).astype(np.float32)
    source = write(tmp_path / "strip.tif", image)
    options = ("--pfa", "1e-3", "--objects", tmp_path / "o.geojson", "--mask", "0,0,80,300")
    ran = rxdetect("score", source, tmp_path / "s.tif", "--lines", *options)
    assert ran.code == 0, ran.err
    with rasterio.open(tmp_path / "s.tif") as data:
        scores = data.read(1)
    np.testing.assert_array_equal(scores, np.stack(list(score_lines(image.swapaxes(0, 1)))))
    first = json.loads((tmp_path / "o.geojson").read_text())["features"][0]["properties"]
    assert (first["row"], first["column"], first["pixels"]) == (200, 40.5, 2)


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (("--method", "rx"), 2, "leave out --method rx"),
        (("--covariance", "mcd"), 1, "leave out --background"),
        (("--save-background", "b.json"), 1, "none to save"),
        (("--p-value", "p.tif"), 1, "no known distribution"),
    ],
)
def test_what_lines_cannot_do(rxdetect, write, tmp_path, monkeypatch, options, code, message):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "strip.tif", np.ones((3, 8, 8), np.float32))
    ran = rxdetect("score", "strip.tif", "s.tif", "--lines", *options)
    assert (ran.code, message in ran.err) == (code, True), ran.err
