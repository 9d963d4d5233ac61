"""Experiments on scenes with truth: their measures against brute force and closed forms, and what they say."""

import base64
import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import cv2
import numpy as np
import pytest

from deglint.physics.presets import preset
from deglint.physics.sensor import noise_equivalent_radiance
from detect.bench import chips, effects, effects_words, measure, roc, roc_words, simulated, thesis, thesis_measure
from detect.bench.section import Effort, Number, over_seeds

USUAL = preset("thesis")
AWAY = (40.0, 0.0)
SMALL = 64


@pytest.fixture
def effort(tmp_path):
    return Effort(True, 2, tmp_path, 1)


def see(tmp_path, sensors, look=(0.0, 0.0), wind=3.0):
    return simulated.see(simulated.setups(sensors, wind, 0, look, SMALL), tmp_path, "scene")


def test_error_is_that_of_a_loop_over_pixels():
    generator = np.random.default_rng(3)
    truth = generator.uniform(1, 2, (7, 6, 8))
    image = truth + generator.normal(size=truth.shape)
    for columns in (slice(None), slice(3)):
        squares = []
        for band in range(5):  # COASTAL to RED
            away = [image[band, r, c] - truth[band, r, c] for r in range(6) for c in range(8)[columns]]
            squares.append(sum(a * a for a in away) / len(away) / np.median(truth[band]) ** 2)
        assert measure.rms_error(image, truth, columns) == pytest.approx(100 * math.sqrt(sum(squares) / 5), rel=1e-12)
    assert measure.rms_error(truth, truth) == 0
    assert measure.rms_error(truth.astype(np.float32), truth.astype(np.float32)) == 0


def test_without_glint_and_noise_there_is_no_error(tmp_path):
    (seen,) = see(tmp_path, [simulated.ideal()], AWAY, 2.0)
    assert seen.made.glint.max() < 1e-3 * seen.truth.min()
    assert measure.rms_error(seen.truth, seen.truth) == 0
    assert measure.rms_error(seen.raw, seen.truth) < 0.2  # what is left of quantisation and shot noise
    assert measure.rms_error(seen.glinting, seen.truth) < 0.1


def test_without_glint_the_error_is_the_noise_of_the_sensor(tmp_path):
    (seen,) = see(tmp_path, [USUAL], AWAY, 2.0)
    assert measure.rms_error(seen.raw, seen.truth) == pytest.approx(measure.rms_error(seen.noisy, seen.truth), rel=0.02)
    squares = []
    for band, truth in zip(USUAL.bands[:5], seen.truth, strict=False):
        noise = noise_equivalent_radiance(truth, USUAL, band)
        squares.append((noise**2).mean() / np.median(truth) ** 2)
    # 5 x 4096 pixels: a standard deviation is known to 0.5 %
    assert measure.rms_error(seen.noisy, seen.truth) == pytest.approx(100 * math.sqrt(np.mean(squares)), rel=0.02)


def test_distances_and_areas_are_those_of_brute_force():
    generator = np.random.default_rng(5)
    image = generator.normal(size=(3, 9, 11))
    kinds = generator.integers(-1, 3, (9, 11))
    sample = np.zeros((9, 11), bool)
    sample[:, :6] = True
    scores = measure.rx_scores(image, sample)
    inside = image[:, sample]
    inverse = np.linalg.inv(np.cov(inside))
    for row, column in ((0, 0), (4, 7), (8, 10)):
        away = image[:, row, column] - inside.mean(axis=1)
        assert scores[row, column] == pytest.approx(away @ inverse @ away, rel=1e-9)
    for number, found in zip((1, 2), measure.curves(scores, kinds, (1, 2)), strict=True):
        pairs = [(x > y) + (x == y) / 2 for x in scores[kinds == number] for y in scores[kinds == 0]]
        assert found.auc == pytest.approx(np.mean(pairs), rel=1e-12)


def test_intervals_end_where_values_cannot_be():
    assert measure.bounded(Number(0.5, low=-1, high=2), 0, 1) == Number(0.5, low=0, high=1)
    assert measure.bounded(Number(5.0, low=-1, high=9), 0) == Number(5.0, low=0, high=9)
    assert math.isnan(measure.bounded(Number(0.5), 0, 1).low)


def test_scenes_hold_what_they_should(tmp_path):
    scenes = see(tmp_path, [simulated.ideal(), USUAL])
    for seen in scenes:
        assert seen.cleaned("none", "off") is seen.raw
        assert sorted(set(seen.kinds[:, SMALL // 2 :].ravel())) == [-1, 0, 1, 2, 3, 4]
        assert not seen.kinds[:, : SMALL // 2 - simulated.SPREAD].any()
        assert seen.sample.mean() == 0.5
        np.testing.assert_array_equal(seen.made.objects > 0, seen.kinds > 0)
        np.testing.assert_allclose(seen.scene.read(), seen.raw, rtol=1e-6)
    late = scenes[1]
    only = late.cleaned("none", "auto")
    same = only == late.scene.read()
    assert 0.2 < same.mean() < 1  # what is no glint stays to the bit, and nothing is removed from it
    assert measure.rms_error(only, late.truth) < measure.rms_error(late.raw, late.truth)
    assert simulated.cleaned_or_none(late, "joyce", "off") is not None
    bare = late.cleaned("none", "auto", protect=False)
    assert (bare != only).any(axis=0).mean() < 0.1
    assert simulated.cleaned_or_none(late, "goodman", "identify-level:4") is None  # an even element is refused
    simulated.forget(scenes)
    assert list(tmp_path.iterdir()) == []


def test_pieces_are_drawn_by_the_truth():
    truth = np.full((5, 4, 6), 2.0)
    image = truth * np.array([1, chips.WHITE, chips.BLACK, 1, 10])[:, None, None]
    image[0, 0, 0] = np.nan
    piece = chips.natural(image, truth, slice(1, 3), slice(2, 6))
    assert piece.shape == (2, 4, 3)
    assert (piece == [255, 0, 255]).all()  # red beyond white, green black, blue white
    drawn = ET.fromstring(chips.strip('a "title" <b>', [("one & two", piece), ("three", piece)]))
    first = next(e for e in drawn.iter() if e.tag.endswith("image"))
    data = base64.b64decode(first.get("href").removeprefix("data:image/png;base64,"))
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1], piece)


def every_word(section):
    return " ".join((*section.words, section.finding, *(every_word(p) for p in section.parts)))


def well_made(section, name):
    """A chapter's names, words and drawings are in order."""
    text = every_word(section)
    assert "nan" not in text
    assert "None" not in text
    for part in (section, *section.parts):
        assert part.name.split("/")[0] == name
        for figure in part.figures:
            ET.fromstring(figure.svg.replace("&minus;", "-"))
        for table in part.tables:
            assert all(len(row) == len(table.head) for row in table.rows)
    for key, number in section.every_number().items():
        assert key.startswith(f"{name}/")
        assert math.isfinite(number.value)


def test_error_against_wind(effort, monkeypatch):
    few = {k: v for k, v in thesis_measure.METHODS.items() if k in ("raw", "joyce", "auto")}
    for module in (thesis, thesis_measure):
        monkeypatch.setattr(module, "METHODS", few)
    found = thesis_measure.measure(effort, (3.0, 2.0), (0.06, 0.0), SMALL)
    assert (found.winds, found.delays, found.failed) == ((2.0, 3.0), (0.0, 0.06), ())
    assert list(effort.directory.iterdir()) == []
    section = thesis.section(found, 2)
    well_made(section, "thesis")
    assert len(section.numbers) == 2 * 2 * (3 * 3 + 2) * 2
    assert section.numbers["thesis/wind03/delay60/joyce/compensated/rms"].better == "lower"
    for wind in found.winds:
        for delay in found.delays:
            noise, raw, joyce = (found.mean(wind, delay, m, "alone").value for m in ("noise", "raw", "joyce"))
            assert noise < raw
            assert delay or joyce < raw
    again = thesis_measure.measure(replace(effort, threads=2), (2.0, 3.0), (0.0, 0.06), SMALL)
    assert again.errors == found.errors  # threads, and the order of what is asked for, never show
    assert len(again.pictures) == 1 + 3 * 3
    for name, piece in again.pictures.items():
        np.testing.assert_array_equal(piece, found.pictures[name])


def made_up(joyce, seeds=3):
    """Findings of one wind and no delay, in which all errors are 10, 20 and 30 % but those of Joyce alone."""
    raw = [thesis_measure.Errors(10.0 * (s + 1), 5.0) for s in range(seeds)]
    errors = {(9.0, 0.0, m, c): raw for m in thesis_measure.METHODS for c in thesis_measure.CHAINS}
    errors[9.0, 0.0, "noise", "alone"] = raw
    errors[9.0, 0.0, "joyce", "alone"] = [thesis_measure.Errors(j, 5.0) for j in joyce[:seeds]]
    return thesis_measure.Found((9.0,), (0.0,), errors, {})


@pytest.mark.parametrize(
    ("joyce", "words"),
    [
        ((11.0, 21.5, 31.0), "alone: at 0 ms and 9 m/s (most at 0 ms and 9 m/s: 20 % becomes 21.2 %"),
        ((9.0, 22.0, 31.0), "Nowhere is it worse than nothing beyond the 95 % interval of the difference."),
        ((9.0, 19.0, 29.0), "Nowhere is it worse than nothing beyond the 95 % interval of the difference."),
    ],
)
def test_a_method_hurts_where_its_paired_difference_says_so(joyce, words):
    section = thesis.section(made_up(joyce), 3)
    said = dict(zip(thesis_measure.METHODS, section.parts, strict=True))
    assert words in " ".join(said["joyce"].words)
    assert "Nowhere" in " ".join(said["hedley"].words)
    helped = "The thesis' chain makes it worse at 0 ms and 9 m/s" in " ".join(said["joyce"].words)
    assert helped == (joyce[2] == 29.0)  # there the chain takes away what Joyce had won


def test_what_protection_keeps_is_said():
    found = made_up((10.0, 20.0, 30.0))
    assert "Protection of small things changes nothing here." in every_word(thesis.section(found, 3))
    found.errors[9.0, 0.0, "auto", "unprotected"] = [thesis_measure.Errors(e, 5.0) for e in (3.0, 3.0, 6.0)]
    words = every_word(thesis.section(found, 3))
    assert "in 1 of 1 combinations of wind and delay, most at 0 ms and 9 m/s, where 4 % becomes 20 %." in words


def test_one_seed_tells_no_interval_and_what_cannot_be_fitted_is_said():
    found = made_up((1000.0,), seeds=1)
    assert "which one seed cannot tell" in every_word(thesis.section(found, 1))
    key = 9.0, 0.0, "lyzenga", "alone"
    without = replace(found, errors={k: v for k, v in found.errors.items() if k != key}, failed=(key,))
    section = thesis.section(without, 1)
    well_made(section, "thesis")
    assert "(1 of all combinations)" in section.tables[0].note
    assert "-" in section.parts[2].tables[0].rows[0]


def test_objects_found(effort, monkeypatch):
    monkeypatch.setattr(roc, "WIND", 3.0)
    looks = ((0.0, 0.0), AWAY)
    found = roc.measure(effort, looks, SMALL)
    assert list(effort.directory.iterdir()) == []
    section = roc.section(found, 2)
    well_made(section, "roc")
    for look in looks:
        for kind in range(4):
            assert found.auc(look, "before", kind).value >= found.auc(look, "after", kind).value - 1e-3
        for image in found.images[look, "after"]:
            assert (np.diff(image.curve, axis=1) >= 0).all()
            assert (image.curve[:, -1] == 1).all()
            for number, rate in enumerate(roc.RATES):  # the curve and the table agree
                near = int(np.argmin(abs(np.log(roc.GRID / rate))))
                if roc.GRID[near] == pytest.approx(rate, rel=1e-9):
                    np.testing.assert_allclose(image.curve[:, near], image.pd[:, number])
    assert found.error(AWAY, "limit").value < found.error((0.0, 0.0), "after").value
    assert section.numbers["roc/look40-000/after/object20/auc"].value > 0.9
    assert re.search(r"Removal by default .* lowers it", every_word(section))


def test_single_effects(effort, monkeypatch):
    monkeypatch.setattr(effects, "WIND", 3.0)
    few = replace(effects.EFFECTS[3], quick=(0.0, 60.0)), replace(effects.EFFECTS[0], quick=(0.0, 4.0))
    monkeypatch.setattr(effects, "EFFECTS", few)
    found = effects.measure(effort, SMALL)
    assert list(effort.directory.iterdir()) == []
    section = effects.section(found, 2)
    well_made(section, "effects")
    none, noise, delay = ("delay", 0.0), ("noise", 4.0), ("delay", 60.0)
    assert found.images[none] == found.images["noise", 0.0]  # the ideal sensor, looked at once
    assert found.change(noise, none, "limit").value > 5
    assert found.change(delay, none, "joyce").value > 5
    assert found.error(none, "limit").value < 0.2
    alone = replace(found, images={k: {s: v[:1] for s, v in i.items()} for k, i in found.images.items()})
    well_made(effects.section(alone, 1), "effects")


def test_levels_and_looks_have_names():
    assert [effects.EFFECTS[0].said(n) for n in (0, 1, 2)] == ["no noise", "the usual noise", "2 times the usual"]
    assert [effects.EFFECTS[3].said(n) for n in (0, 1)] == ["no delay", "1 ms"]
    assert effects.EFFECTS[1].said(30.0) == "f/30"
    assert roc_words.look((20.0, 180.0)) == "20 deg to the glint"
    assert roc_words.look((0.0, 0.0)) == "nadir"
    one = over_seeds([1.0, 1.0, 1.1])
    assert effects_words._sure(one) == ""
    assert "within" in effects_words._sure(over_seeds([1.0, -1.0]))
    noisy = effects.EFFECTS[0].on(simulated.ideal(), 1.0)
    assert (noisy.well, noisy.read_noise, noisy.bits) == (USUAL.well, USUAL.read_noise, USUAL.bits)
