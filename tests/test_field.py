"""`python -m benchmarks field` and `pictures`: others run their own code, what is missing is named."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmarks import field, field_peers, pictures, scenes
from deglint import Recipe

MODULE = "def hedley(deep, bands, nir):\n    bands -= nir * deep.mean()\n    return bands\n"


@pytest.fixture
def told():
    image = np.random.default_rng(1).uniform(1, 2, (4, 40, 40))
    return field_peers.Told(image, np.full((4, 1, 1), 3.0), 3, (0, 1, 2), (480, 560, 660, 830), np.ones((40, 40), bool))


@pytest.fixture
def known(tmp_path):
    case = replace(scenes.OWN[1], wind=3.0)
    return scenes.Known.of(case.written(tmp_path))


def test_others_run_their_own_code_on_copies_and_missing_ones_are_named(tmp_path, told):
    home = tmp_path / "sensingpy" / "preprocessing"
    home.mkdir(parents=True)
    (home / "deglinting.py").write_text(MODULE)
    (tmp_path / "sensingpy" / "__init__.py").write_text("raise RuntimeError('maps and plots')")
    before = told.image.copy()
    ready, missing = field.programs(tmp_path)
    found = ready["sensingpy, Hedley"](tmp_path, told)
    np.testing.assert_array_equal(told.image, before)
    np.testing.assert_allclose(found[:3], before[:3] - before[3])
    np.testing.assert_array_equal(found[3], before[3])
    assert set(ready) | set(missing) >= {peer.name for peer in field_peers.PEERS}
    assert "glint_correct" in missing["ASP glint_correct"]
    assert set(field.programs(None)[1]) == {peer.name for peer in field_peers.PEERS}


@pytest.mark.slow
def test_what_is_measured(known):
    told = field.told_of(known)
    assert told.deep.any()
    assert told.nir not in told.visible
    there = np.zeros(known.counts.shape, bool)
    there[100:112, 100:112] = True
    clean = known.truth.copy()
    clean[:, 100:112, 100:112] += known.level[:, None, None]
    marked = replace(known, truth=clean)
    half = known.truth + (clean - known.truth) / 2
    assert field.contrasts(clean, marked, there) == [pytest.approx(1, rel=0.05)]
    assert field.contrasts(half, marked, there) == [pytest.approx(0.5, rel=0.05)]
    found = {name: field.PixelCounts(errors={"p1": e, "wind": e}, shares=[s], lost=[0.0])
             for name, e, s in (("raw", 8.0, 1.0), ("deglint remove", 4.0, 0.9), ("other", 2.0, 0.1))}  # fmt: skip
    seconds = {"deglint remove": 2.0, "other": 1.0}
    text = "\n\n".join(field.parts(found, seconds, {"lost one": "no folder"}, 512))
    assert re.search(r"\| other +\| 2\.0 +\| 2\.0", text)
    assert re.search(r"\| other +\| 2 +\| 0 +\| 0\.00 +\| - +\| 0\.0 +\| 1\.00 \(0\.500\)", text)
    assert "0.500 to 0.500 of the time" in text
    assert re.search(r"\| p1 +\| 4\.0 +\| 2\.0 +\| other", text)
    assert "Not at hand: lost one (no folder)." in text


@pytest.mark.slow
def test_pictures_show_four_images_and_print_errors(known, tmp_path, capsys):
    view = pictures.View(known.path, 0, 0, "case.png", remedy=Recipe(method="joyce", compensate="off"))
    pictures.drawn(view, tmp_path / "case.png")
    said = capsys.readouterr().out
    raw = known.error(scenes.open_scene(known.path).read())
    assert f"raw {raw:.1f} %" in said
    assert re.search(r"deglint remove [\d.]+ %, joyce off [\d.]+ %", said)
    high, wide, _ = cv2.imread(str(tmp_path / "case.png")).shape
    assert (high, wide) == (2 * pictures.VIEW_SIDE + 30, 4 * 2 * pictures.VIEW_SIDE + 18)
