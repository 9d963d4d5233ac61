"""The public names: what type checkers see of them, and what they say of a wrong value."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import deglint
import detect

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("package", [deglint, detect])
def test_checkers_are_shown_the_names_that_are_loaded(package):
    tree = ast.parse(Path(package.__file__).read_text(encoding="utf-8"))
    shown = {
        f"{alias.asname}": node.module
        for block in tree.body
        if isinstance(block, ast.If)
        for node in block.body
        if isinstance(node, ast.ImportFrom) and node.level == 1
        for alias in node.names
    }
    assert shown == package._HOMES
    assert sorted([*shown, "__version__"], key=str.casefold) == sorted(package.__all__, key=str.casefold)
    assert Path(package.__file__).with_name("py.typed").exists()
    for name, home in shown.items():
        assert getattr(package, name) is not None, name
        assert hasattr(importlib.import_module(f"{package.__name__}.{home}"), name)


def test_mypy_knows_signatures_and_misspelt_names(tmp_path):
    pytest.importorskip("mypy")
    script = tmp_path / "script.py"
    script.write_text(
        "import deglint, detect\n"
        "reveal_type(deglint.open_scene)\n"
        "reveal_type(detect.rx)\n"
        "deglint.remove_glint('a.tif', 'b.tif', deglint.Recipe(metod='hedley'))\n"
        "deglint.opne_scene\n"
    )
    call = [sys.executable, "-m", "mypy", "--follow-imports=silent", str(script)]
    said = subprocess.run(call, capture_output=True, text=True, check=False, cwd=ROOT).stdout
    assert "-> deglint.scene.Scene" in said
    assert 'note: Revealed type is "def (image: numpy.ndarray' in said
    assert 'Unexpected keyword argument "metod"' in said
    assert 'has no attribute "opne_scene"' in said


def test_rx_is_called_with_an_array(sea):
    image = sea(dtype="float32")
    image[:, 20, 30] *= 3
    scores = detect.rx(image)
    assert scores.shape == image.shape[1:]
    assert np.unravel_index(scores.argmax(), scores.shape) == (20, 30)
    image[1, 5, 6] = -999
    image[2, 8, 9] = np.nan
    for left in (detect.rx(image, nodata=-999), detect.rx(np.ma.masked_equal(image, -999))):
        assert np.argwhere(np.isnan(left)).tolist() == [[5, 6], [8, 9]]
    mask = np.ones(scores.shape, np.bool_)
    mask[40:] = False
    assert np.isnan(detect.rx(image, mask=mask, nodata=-999)).sum() == mask.size - mask.sum() + 2
    assert detect.rx is importlib.import_module("detect.rx")  # and the module has the rest
