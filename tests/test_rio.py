"""`rio deglint` and `rio rxdetect`: the entry points of the project in rasterio's own program."""

import logging
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from click.testing import CliRunner
from rasterio.rio.main import main_group

GROUP = "rasterio.rio_plugins"
DECLARED = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]["entry-points"][GROUP]


@pytest.fixture
def rio(monkeypatch):
    """Run rio with the plugins that pyproject.toml declares, whatever is installed."""
    plugins = {name: EntryPoint(name, value, GROUP).load() for name, value in DECLARED.items()}
    monkeypatch.setattr(main_group, "commands", main_group.commands | plugins)
    return lambda *arguments: CliRunner().invoke(main_group, [str(a) for a in arguments], prog_name="rio")


def test_rio_lists_them(rio):
    lines = rio("--help").output.splitlines()
    assert any(line.strip().startswith("deglint ") and "sun glint" in line for line in lines)
    assert any(line.strip().startswith("rxdetect ") for line in lines)


@pytest.mark.parametrize("call", ["deglint remove", "rxdetect score"])
def test_help_is_that_of_the_command(rio, call):
    ran = rio(*call.split(), "--help")
    assert ran.exit_code == 0
    assert ran.output.startswith(f"Usage: rio {call} ")


def test_a_scene_is_deglinted_and_each_line_logged_once(rio, sea, write, tmp_path, monkeypatch):
    heard = []
    monkeypatch.setattr(logging.root, "handlers", [type("Root", (logging.Handler,), {"emit": heard.append})()])
    source = write(tmp_path / "in.tif", sea())
    ran = rio("deglint", "remove", source, tmp_path / "out.tif", "--method", "hedley", "-b", "red")
    assert ran.exit_code == 0, ran.output
    assert (tmp_path / "out.tif.json").exists()
    assert not heard
    assert rio("deglint", "remove", source, tmp_path / "out.tif").exit_code == 1
    assert rio("deglint", "remove", "--method", "magic").exit_code == 2
