"""CONTRIBUTING.md says what is there, and its walks to a new method, stage and detector work."""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rasterio

import deglint
from deglint.compensate.replace_glint import put
from deglint.compensate.stages import STAGES, Kind
from deglint.pipeline import load_chain, load_model
from deglint.remove import METHODS, Method, hedley
from deglint.remove.request import regression_plan
from detect.rx import DETECTORS

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text()


def test_the_files_and_tables_that_it_names_exist():
    paths = set(re.findall(r"`((?:deglint|detect|tests|docs|recipe)/[\w/.]*)`", TEXT)) - {"deglint/remove/NAME.py"}
    assert len(paths) > 8
    assert [p for p in paths if not (ROOT / p).exists()] == []
    for table, path in re.findall(r"to `([A-Z_]+)` in `([\w/.]+)`", TEXT):
        assert re.search(rf"^{table}\b", (ROOT / path).read_text(), re.MULTILINE), (table, path)


def test_a_new_method_is_a_module_and_a_line_of_the_table(monkeypatch, sea, write, tmp_path):
    def fit(request, stats):
        return replace(hedley.fit(request, stats), method="mine")

    monkeypatch.setitem(METHODS, "mine", Method("as Hedley", fit, regression_plan, ("regression",)))
    source = write(tmp_path / "in.tif", sea())
    options = {"sample": "all", "mask": "none", "compensate": "off"}
    result = deglint.remove_glint(source, tmp_path / "mine.tif", deglint.Recipe(method="mine", **options))
    deglint.remove_glint(source, tmp_path / "hedley.tif", deglint.Recipe(method="hedley", **options))
    assert result.fitted.model.method == "mine"
    with rasterio.open(tmp_path / "mine.tif") as mine, rasterio.open(tmp_path / "hedley.tif") as other:
        assert (mine.read() == other.read()).all()


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
    recipe = deglint.Recipe(method="hedley", sample="all", mask="none", compensate="remove, ceiling:300")
    deglint.remove_glint(source, out, recipe, model_file=model)
    assert (read(out).max(axis=(1, 2)) == 300).all()
    assert (read(source).max(axis=(1, 2)) > 300).all()
    again = {"model": load_model(str(model)), "chain": load_chain(str(model))}
    deglint.remove_glint(source, tmp_path / "again.tif", **again)
    assert (read(tmp_path / "again.tif") == read(out)).all()


def test_a_new_detector_is_a_line_of_the_table(monkeypatch, sea, write, read, tmp_path, rxdetect):
    monkeypatch.setitem(DETECTORS, "mine", replace(DETECTORS["rx"]))
    source = write(tmp_path / "in.tif", sea())
    for method in ("mine", "rx"):
        ran = rxdetect("score", source, tmp_path / f"{method}.tif", "--method", method, "--mask", "none")
        assert ran.code == 0, ran.err
    assert (read(tmp_path / "mine.tif") == read(tmp_path / "rx.tif")).all()
