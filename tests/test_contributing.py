"""CONTRIBUTING.md says what is there, and its walks to a new method, stage and detector work."""

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import f as f_law

import deglint as library
from deglint.compensate.replace_glint import put
from deglint.compensate.stages import STAGES, Kind
from deglint.pipeline import load_chain, load_model
from deglint.remove import METHODS, Method, hedley, wiener
from deglint.remove.request import regression_plan
from detect.global_rx import DETECTORS
from detect.global_rx import Method as Detector

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text()


def test_the_files_and_tables_that_it_names_exist():
    paths = set(re.findall(r"`((?:deglint|detect|tests|docs|recipe|qgis)/[\w/.]*)`", TEXT)) - {"deglint/remove/NAME.py"}
    assert len(paths) > 8
    assert [p for p in paths if not (ROOT / p).exists()] == []
    for table, path in re.findall(r"to `([A-Z_]+)` in `([\w/.]+)`", TEXT):
        assert re.search(rf"^{table}\b", (ROOT / path).read_text(), re.MULTILINE), (table, path)


def test_a_new_method_is_a_module_and_a_line_of_the_table(monkeypatch, sea, write, read, tmp_path, deglint):
    def fit(request, stats):
        return replace(hedley.fit(request, stats), method="mine")

    monkeypatch.setitem(METHODS, "mine", Method("as Hedley, by another name", fit, regression_plan, ("regression",)))
    assert "mine             as Hedley, by another name; takes --regression\n" in deglint("remove", "--help").out
    source, model = write(tmp_path / "in.tif", sea()), tmp_path / "model.json"
    plain = ("--sample", "all", "--mask", "none", "--regression", "huber")
    for method, more in (("mine", ("--save-model", model)), ("hedley", ())):
        ran = deglint("remove", source, tmp_path / f"{method}.tif", "--method", method, *plain, *more)
        assert ran.code == 0, ran.err
    assert (read(tmp_path / "mine.tif") == read(tmp_path / "hedley.tif")).all()
    assert load_model(str(model)).method == "mine"
    ran = deglint("remove", source, tmp_path / "again.tif", "--model", model, "--mask", "none")
    assert ran.code == 0, ran.err
    assert (read(tmp_path / "again.tif") == read(tmp_path / "mine.tif")).all()


def test_a_new_method_of_neighbouring_pixels_is_fitted_too(monkeypatch, sea, write, read, tmp_path):
    """Alone, among stages, and after an opening, for which it has no variant."""

    def fit(request, tiles):
        return replace(wiener.fit(request, tiles), method="mine", warnings=("of mine",))

    monkeypatch.setitem(METHODS, "mine", Method("as wiener, by another name", fit, neighbours=True))
    source = write(tmp_path / "in.tif", sea(200, 200))
    for stages in ("off", "remove, posterior", "identify-level:5, replace-level, remove"):
        images = []
        for method in ("mine", "wiener"):
            recipe = library.Recipe(method=method, compensate=stages, mask="none")
            result = library.remove_glint(source, tmp_path / "out.tif", recipe, overwrite=True)
            images.append(read(tmp_path / "out.tif"))
            assert ("of mine" in result.fitted.model.warnings) == (method == "mine")
        assert (images[0] == images[1]).all() == ("identify-level" not in stages)


@dataclass(frozen=True)
class Ceiling:
    """A stage: nothing is brighter than a limit, also in bands that the removal does not correct."""

    name = "ceiling"
    limit: float
    halo = 0

    def apply(self, state):
        return put(state, state.image > self.limit, np.full_like(state.image, self.limit))


def test_a_new_stage_is_a_module_and_a_line_of_the_table(monkeypatch, sea, write, read, tmp_path):
    kind = Kind(lambda _sample, _setting, number: Ceiling(number), Ceiling, 1, 30_000, replaces="image")
    monkeypatch.setitem(STAGES, "ceiling", kind)
    source, out, model = (tmp_path / name for name in ("in.tif", "out.tif", "model.json"))
    write(source, sea())
    recipe = library.Recipe(method="hedley", sample="all", mask="none", compensate="remove, ceiling:300")
    library.remove_glint(source, out, recipe, model_file=model)
    assert (read(out).max(axis=(1, 2)) == 300).all()
    assert (read(source).max(axis=(1, 2)) > 300).all()
    again = {"model": load_model(str(model)), "chain": load_chain(str(model))}
    library.remove_glint(source, tmp_path / "again.tif", **again)
    assert (read(tmp_path / "again.tif") == read(out)).all()


def test_a_new_detector_is_a_function_and_a_line_of_the_table(monkeypatch, sea, write, read, tmp_path, rxdetect):
    def in_first_band(background, *_):
        return (np.eye(1, background.bands) / np.sqrt(background.covariance[0, 0]),)

    line = Detector("squared distance from the mean of the first band, in variances", in_first_band, law=True)
    monkeypatch.setitem(DETECTORS, "mine", line)
    assert "mine      squared distance from the mean of the first band" in rxdetect("score", "--help").out
    pixels, truth = sea(), np.zeros((1, 80, 100), np.uint8)
    pixels[0, 40:44, 50:54] += 900
    truth[0, 40:44, 50:54] = 1
    source, known = write(tmp_path / "in.tif", pixels), write(tmp_path / "truth.tif", truth, names=None)
    out, p, found = (tmp_path / name for name in ("out.tif", "p.tif", "found.geojson"))
    call = ("--method", "mine", "--pfa", "1e-3", "--threshold", "chi2", "--p-value", p, "--objects", found)
    ran = rxdetect("score", source, out, *call)
    assert ran.code == 0, ran.err
    band = pixels[0].astype(float)
    expected = (band - band.mean()) ** 2 / band.var(ddof=1)
    np.testing.assert_allclose(read(out)[0], expected, rtol=1e-6)
    np.testing.assert_allclose(read(p)[0], f_law.sf(expected * 8000 / 8001, 1, 7999), rtol=1e-4)
    inside, outside = expected[truth[0] == 1], expected[truth[0] == 0]
    judged = json.loads(rxdetect("roc", out, known, "--json", "--bootstrap", "0").out)
    assert judged["detectors"][0]["auc"] == np.mean(inside[:, None] > outside)
    assert len(json.loads(found.read_text())["features"]) >= 1
