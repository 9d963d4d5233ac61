"""The QGIS plugin: its tables agree with the commands; algorithms run in qgis_process where that is installed."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from deglint.cli import cli as deglint_cli
from detect.cli import cli as detect_cli

QGIS = Path(__file__).parents[1] / "qgis"


def loaded(path):
    spec = importlib.util.spec_from_file_location(f"qgis_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


commands = loaded(QGIS / "deglint_qgis" / "commands.py")


@pytest.mark.parametrize("key", commands.ALGORITHMS)
def test_parameters_are_options_of_the_command(key):
    algorithm = commands.ALGORITHMS[key]
    group = {"deglint": deglint_cli, "rxdetect": detect_cli}[algorithm.program]
    options = {flag: p for p in group.get_command(None, algorithm.command).params for flag in p.opts}
    for parameter in algorithm.parameters:
        assert parameter.flag in ("", ">") or parameter.flag in options, parameter
        if parameter.choices:
            assert parameter.choices == tuple(options[parameter.flag].type.choices)


@pytest.mark.parametrize(
    ("key", "values", "expected"),
    [
        ("remove", {"INPUT": "-a b.tif", "METHOD": "hedley", "NIR": "", "FLAGS": "f.tif", "OUTPUT": "o.tif"},
         ["remove", "--method", "hedley", "--flags", "f.tif", "--overwrite", "--", "-a b.tif", "o.tif"]),
        ("info", {"INPUT": "a.tif", "OUTPUT": "a.txt"}, ["info", "--", "a.tif"]),
        ("score", {"INPUT": "a.tif", "PFA": 1e-4, "OBJECTS": "o.gpkg", "OUTPUT": "s.tif"},
         ["score", "--pfa", "0.0001", "--objects", "o.gpkg", "--overwrite", "--", "a.tif", "s.tif"]),
        ("plan", {"PLACE": (-122.0, 36.8), "WIND": "7@310", "DEPTH": 5.0, "OUTPUT": "p.png"},
         ["plan", "--lon", "-122.000000", "--lat", "36.800000", "--wind", "7@310", "--depth", "5.0", "-o", "p.png",
          "--overwrite"]),
    ],
)  # fmt: skip
def test_parameters_become_arguments(key, values, expected):
    assert commands.arguments(key, values) == expected


@pytest.mark.slow
def test_a_command_runs_and_says_what_it_does(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    said, shares = [], []
    values = {"INPUT": source, "METHOD": "hedley", "OUTPUT": tmp_path / "out.tif"}
    call = [sys.executable, "-m", "deglint", *commands.arguments("remove", values)]
    commands.FOREIGN = ()  # this Python's own variables
    assert commands.run(call, said.append, shares.append, lambda: False) == (0, "")
    assert "pixels corrected" in said[-1]
    call = [sys.executable, "-m", "deglint", *commands.arguments("info", {"INPUT": source})]
    assert "suggested recipe" in commands.run(call, said.append, shares.append, lambda: False)[1]
    sleep = [sys.executable, "-c", "import time; time.sleep(60)"]
    assert commands.run(sleep, said.append, shares.append, lambda: True)[0] == 130


def test_the_command_is_looked_for_and_its_remedy_named(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("DEGLINT_BIN", str(tmp_path))
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    with pytest.raises(FileNotFoundError, match="pip install deglint"):
        commands.executable("deglint")
    (tmp_path / "deglint").touch(0o755)
    assert commands.executable("deglint") == [str(tmp_path / "deglint")]


def test_the_archive_holds_the_plugin(tmp_path):
    with zipfile.ZipFile(loaded(QGIS / "make_zip.py").make_zip(tmp_path)) as archive:
        names = {f"deglint_qgis/{n}" for n in ("__init__.py", "commands.py", "plugin.py", "metadata.txt", "LICENSE")}
        assert set(archive.namelist()) == names
        newest = re.search(r"^## \[([\d.]+)\]", (QGIS.parent / "CHANGELOG.md").read_text(), re.MULTILINE)[1]
        assert f"version={newest}\n" in archive.read("deglint_qgis/metadata.txt").decode()


@pytest.mark.skipif(shutil.which("qgis_process") is None, reason="needs qgis_process, from Debian's package qgis")
def test_the_algorithms_run_in_qgis(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    folder = tmp_path / "bin"
    folder.mkdir()
    for program, package in (("deglint", "deglint"), ("rxdetect", "detect")):
        script = folder / program
        script.write_text(f"#!/bin/sh\nPYTHONPATH='{QGIS.parent}' exec '{sys.executable}' -m {package} \"$@\"\n")
        script.chmod(0o755)
    own = {
        "QGIS_PLUGINPATH": str(QGIS),
        "DEGLINT_BIN": str(folder),
        "HOME": str(tmp_path),
        "QT_QPA_PLATFORM": "offscreen",
    }

    def process(*words):
        call = ["qgis_process", *words]
        done = subprocess.run(call, capture_output=True, text=True, check=False, env=os.environ | own)
        assert done.returncode == 0, done.stdout + done.stderr

    process("plugins", "enable", "deglint_qgis")
    out = {name: tmp_path / name for name in ("clean.tif", "flags.tif", "info.txt", "scores.tif", "plan.png")}
    process("run", "deglint:remove", "--", f"INPUT={source}", "METHOD=2", f"FLAGS={out['flags.tif']}",
            f"OUTPUT={out['clean.tif']}")  # fmt: skip
    process("run", "deglint:info", "--", f"INPUT={source}", f"OUTPUT={out['info.txt']}")
    process("run", "deglint:score", "--", f"INPUT={source}", "METHOD=3", f"OUTPUT={out['scores.tif']}")
    process(
        "run",
        "deglint:plan",
        "--",
        "PLACE=-122,36.8 [EPSG:4326]",
        "TIME=2026-06-21T18:00Z",
        f"OUTPUT={out['plan.png']}",
    )
    assert all(path.stat().st_size for path in out.values())
