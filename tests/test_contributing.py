"""CONTRIBUTING.md says what is there, and its walk to a new removal method works."""

import re
from dataclasses import replace
from pathlib import Path

import rasterio

import deglint
from deglint.remove import METHODS, Method, hedley
from deglint.remove.request import slope_weights

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text()


def test_the_files_and_tables_that_it_names_exist():
    paths = set(re.findall(r"`((?:deglint|detect|tests|docs|recipe)/[\w/.]*)`", TEXT)) - {"deglint/remove/NAME.py"}
    assert len(paths) > 8
    assert [p for p in paths if not (ROOT / p).exists()] == []
    for table, path in re.findall(r"to `([A-Z]+(?:_NAMES)?)` in `([\w/.]+)`", TEXT):
        assert re.search(rf"^{table}\b", (ROOT / path).read_text(), re.MULTILINE), (table, path)


def test_a_new_method_is_a_module_and_a_line_of_the_table(monkeypatch, sea, write, tmp_path):
    def fit(request, stats):
        return replace(hedley.fit(request, stats), method="mine")

    monkeypatch.setitem(METHODS, "mine", Method("as Hedley, by another name", fit, hedley.plan, True, slope_weights))
    source = write(tmp_path / "in.tif", sea())
    options = {"sample": "all", "mask": "none", "compensate": "off"}
    result = deglint.remove_glint(source, tmp_path / "mine.tif", deglint.Recipe(method="mine", **options))
    deglint.remove_glint(source, tmp_path / "hedley.tif", deglint.Recipe(method="hedley", **options))
    assert result.fitted.model.method == "mine"
    with rasterio.open(tmp_path / "mine.tif") as mine, rasterio.open(tmp_path / "hedley.tif") as other:
        assert (mine.read() == other.read()).all()
