"""The command line: exit codes, what goes to stdout and what to stderr, and how quickly it starts."""

import json
import os
import pty
import resource
import subprocess
import sys
import threading

import numpy as np
import pytest

from deglint import cli
from deglint.cli import options
from deglint.cli import remove as command
from deglint.raster.output import DTYPES
from deglint.remove import METHODS, NIR_USES, REGRESSIONS
from detect.global_rx import DETECTORS

from .common import RUN, says


def child(code):
    """User + system time [s] of a fresh interpreter, and what it prints."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, *code], capture_output=True, text=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, done.stdout


@pytest.mark.parametrize("code", [["-c", "import deglint"], ["-m", "deglint", "--help"]], ids=["import", "help"])
def test_starting_costs_little_processor_time(code):
    assert min(child(code)[0] for _ in range(3)) < 0.4


@pytest.mark.parametrize(
    ("code", "needed"),
    [("import deglint", []), ("import deglint.cli; deglint.cli.run(['--help'])", []),
     ("import deglint.cli; deglint.cli.run(['remove', '--help'])", ["numpy", "cv2"])],  # names its methods
)  # fmt: skip
def test_starting_loads_no_heavy_package(code, needed):
    heavy = ["numpy", "rasterio", "numba", "cv2", "scipy", "sklearn", "skimage", "matplotlib", "dask"]
    said = child(["-c", f"{code}\nimport sys\nprint('loaded', [m for m in {heavy} if m in sys.modules])"])[1]
    assert f"loaded {needed}" in said


def test_the_choices_of_the_command_line_are_the_tables():
    choices = {p.name: p.type.choices for p in command.remove.params if isinstance(p.type, options.ChoiceFromTable)}
    tables = {"method": ("auto", *METHODS), "regression": ("auto", *REGRESSIONS), "nir_use": ("auto", *NIR_USES)}
    assert choices == tables | {"dtype": DTYPES}


@pytest.mark.parametrize(("call", "table"), [("deglint remove", METHODS), ("rxdetect score", DETECTORS)])
def test_help_says_what_each_method_does_and_which_options_it_takes(call, table, request):
    program, command = call.split()
    said = "".join(request.getfixturevalue(program)(command, "--help").out.split())
    for name, method in table.items():
        takes = "; takes " + ", ".join(f"--{option}" for option in method.options) if method.options else ""
        assert f"{name}{method.summary}{takes.replace('_', '-')}".replace(" ", "") in said


@pytest.mark.parametrize(
    ("program", "name", "groups"),
    [("deglint", "remove",
      ["What to do:", "Methods:", "Details of the fit:", "Input:", "Output:", "Processing:", "Messages:"]),
     ("deglint", "info", ["What to do:", "Input:", "Processing:", "Messages:"]),
     ("deglint", "batch", ["Output:", "Processing:", "Messages:"]),
     ("rxdetect", "score", ["What to do:", "Methods:", "Input:", "Output:", "Processing:", "Messages:"])],
)  # fmt: skip
def test_help_lists_options_in_groups_with_their_defaults(program, name, groups, request):
    ran = request.getfixturevalue(program)(name, "--help")
    assert (ran.code, ran.err) == (0, "")
    assert [line for line in ran.out.splitlines() if line.endswith(":") and not line.startswith(" ")] == groups
    messages = ran.out[ran.out.index("Messages:") :]
    assert all(option in messages for option in ("--json", "--verbose", "--quiet", "--help"))
    options = ran.out[ran.out.index(groups[0]) :]
    assert "IN [IN ...]" not in options
    if name in ("remove", "score"):
        assert "deduced from the" in options


def test_done_is_0_and_stdout_stays_empty(deglint, sea, write, tmp_path):
    ran = deglint("remove", write(tmp_path / "in.tif", sea()), tmp_path / "out.tif", *RUN)
    assert ran.code == 0
    assert ran.out == ""
    assert "out.tif: 8000 of 8000 pixels corrected" in ran.err


def test_quiet_says_nothing(deglint, sea, write, tmp_path):
    ran = deglint("remove", write(tmp_path / "in.tif", sea()), tmp_path / "out.tif", *RUN, "-q")
    assert ran == (0, "", "")


def test_json_is_all_there_is_on_stdout(deglint, sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    ran = deglint("remove", source, tmp_path / "out.tif", *RUN, "--json")
    assert json.loads(ran.out) == json.loads((tmp_path / "out.tif.json").read_text())
    info = deglint("info", source, "--json")
    assert info.code == 0
    assert json.loads(info.out)["nir"] == ["nir"]


def test_info_tells_people_the_same(deglint, sea, write, tmp_path):
    ran = deglint("info", write(tmp_path / "in.tif", sea()))
    assert ran.code == 0
    assert ran.err == ""
    assert "100 x 80 pixels, 4 bands, uint16" in ran.out
    assert says(ran.out, "delay", "median glint", "suggested recipe")
    assert "80 pixels, 1 band, uint16" in deglint("info", write(tmp_path / "one.tif", sea()[3:], names=["nir"])).out


@pytest.mark.parametrize(("sample", "said"), [("missing.geojson", "no such file"), ("900,0,5,5", "off the scene")])
def test_info_refuses_a_wrong_sample(deglint, sea, write, tmp_path, sample, said):
    ran = deglint("info", write(tmp_path / "in.tif", sea()), "--sample", sample)
    assert (ran.code, ran.out) == (1, "")
    assert "--sample" in ran.err
    assert said in ran.err


def test_failing_is_1_with_one_line(deglint, tmp_path):
    ran = deglint("remove", tmp_path / "none.tif", tmp_path / "out.tif")
    assert ran.code == 1
    assert ran.out == ""
    assert ran.err.startswith("Error: no such file: ")
    assert ran.err.count("\n") == 1


@pytest.mark.parametrize("verbose", [["-vv"], ["-v", "-v"], ["-qvv"], ["--verbose", "--verbose"]])
def test_a_traceback_comes_only_when_asked_for(deglint, sea, write, tmp_path, verbose):
    ran = deglint("remove", tmp_path / "none.tif", tmp_path / "out.tif", *verbose)
    assert ran.code == 1
    assert "Traceback" in ran.err
    assert "Traceback" not in deglint("remove", tmp_path / "none.tif", tmp_path / "out.tif", "-v").err


def test_the_exit_code_of_no_water_is_3_with_a_traceback_too(deglint, sea, write, tmp_path):
    source = write(tmp_path / "in.tif", np.zeros((4, 40, 40), np.uint16), nodata=0)
    for verbose in ([], ["-vv"]):
        assert deglint("remove", source, tmp_path / "out.tif", *verbose).code == 3


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--method", "magic"], list(METHODS)),
        (["--regression", "magic"], list(REGRESSIONS)),
        (["--nir-use", "magic"], ["mean", "best", "set"]),
        (["--dtype", "complex64"], ["float32", "uint16"]),
        (["--nodata", "nothing"], ["not a number"]),
        (["--threads", "0"], ["1<=x<=1024"]),
        (["--floor-percentile", "101"], ["0<=x<=100"]),
        (["--floor-percentile", "5%"], ["'5%' is not a valid number from 0 to 100, such as 5."]),
        (["--method", "headley"], ["did you mean 'hedley'?"]),
        (["--mask", "watr"], ["'--mask'", "'watr' is not one of auto, none, nor a file"]),
        (["--mask", "None"], ["'None' is not", "did you mean 'none'?"]),
        (["--mask", "a" * 300], ["aaa' is not one of auto, none, nor a file that is there."]),
        (["--sample", "none"], ["'--sample'", "'none' is not one of auto, all, nor a file"]),
        (["--co", "ZSTD"], ["NAME=VALUE"]),
        (["--co", "=ZSTD"], ["NAME=VALUE"]),
        (["--frobnicate"], ["No such option"]),
        (["--model", "m.json", "--method", "hedley"], ["leave out --method"]),
        (["--model", "m.json", "--compensate", "thesis", "--nir-use", "best"], ["leave out --nir-use, --compensate"]),
        (["--model", "m.json", "--floor-percentile", "5"], ["leave out --floor-percentile."]),
        (["--model", "m.json", "--rrs-factor", "2", "--smallest-object", "3m"], ["--rrs-factor, --smallest-object"]),
    ],
)
def test_usage_is_2_and_lists_the_choices(deglint, sea, write, tmp_path, arguments, said):
    ran = deglint("remove", "in.tif", tmp_path / "out.tif", *arguments)
    assert ran.code == 2
    assert ran.out == ""
    assert all(word in ran.err for word in said), ran.err
    assert "Traceback" not in ran.err


@pytest.mark.parametrize("name", ["plan", "simulate", "remove"])
def test_help_spells_defaults_in_one_way(deglint, name):
    said = " ".join(deglint(name, "--help").out.split())
    assert "[default: " in said
    assert " by default" not in said
    assert "(default)" not in said


def test_choices_are_taken_in_capitals_too(deglint, sea, write, read, tmp_path):
    source, out = write(tmp_path / "in.tif", sea()), tmp_path / "out.tif"
    ran = deglint(
        "remove",
        source,
        out,
        "--method",
        "Hedley",
        "--sample",
        "all",
        "--mask",
        "none",
        "--dtype",
        "Float32",
        "--nir-use",
        "MEAN",
    )
    assert ran.code == 0, ran.err
    assert json.loads((tmp_path / "out.tif.json").read_text())["model"]["method"] == "hedley"
    assert read(out).dtype == np.float32
    ran = deglint("simulate", tmp_path / "s", "--dry-run", "--objects", "None")
    assert ran.code == 0, ran.err


def test_simulate_takes_a_sensor_by_the_option_of_plan(deglint, tmp_path):
    call = "simulate", tmp_path / "s", "--dry-run"  # which says the size: sensors differ in their number of bands
    assert deglint(*call, "--sensor", "micasense").code == 0
    assert deglint(*call, "--sensor", "micasense") == deglint(*call, "--preset", "micasense")
    assert deglint(*call, "--sensor", "micasense") != deglint(*call, "--sensor", "thesis")


def test_unknown_commands_and_missing_arguments_are_usage(deglint):
    assert deglint("frobnicate").code == 2
    assert deglint("remove").code == 2
    assert deglint("remove", "only_one.tif").code == 2
    assert deglint("info").code == 2
    assert deglint("--version").code == 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--sensor", "landsat99"], "worldview3"),
        (["--nir", "swir9"], "1 blue (485 nm)"),
        (["--nir", "9"], "numbers 1-4"),
        (["-b", "purple"], "4 nir (840 nm)"),
        (["-b", "nir"], "only the NIR is left"),
        (["--nodata", "-1"], "0 to 65535"),
        (["--nodata", "nan"], "0 to 65535"),
        (["--sample", "none.geojson"], "no such file: none.geojson (--sample)"),
        (["--mask", "none.tif"], "no such file: none.tif"),
        (["--model", "none.json"], "no such file: none.json (--model)"),
        (["--grid", "7"], "finest"),
    ],
)
def test_what_does_not_fit_the_scene_is_said_with_what_would(deglint, sea, write, tmp_path, arguments, said):
    ran = deglint("remove", write(tmp_path / "in.tif", sea()), tmp_path / "out.tif", *arguments)
    assert ran.code == 1
    assert said in ran.err
    assert ran.err.count("\n") == 1
    assert not (tmp_path / "out.tif").exists()


def test_a_fault_of_its_own_is_one_line_too(deglint, monkeypatch, tmp_path):
    def broken(*_, **__):
        raise ZeroDivisionError("first\nsecond")

    monkeypatch.setattr("deglint.pipeline.remove_glint", broken)
    ran = deglint("remove", "in.tif", tmp_path / "out.tif")
    assert ran.code == 1
    assert ran.err.startswith("Error: ZeroDivisionError: first second (")
    assert "-vv" in ran.err
    assert ran.err.count("\n") == 1


def test_running_in_a_thread_is_allowed(sea, write, tmp_path):
    codes = []
    source = write(tmp_path / "in.tif", sea())
    call = ["remove", source, str(tmp_path / "out.tif"), *RUN, "-q"]
    thread = threading.Thread(target=lambda: codes.append(cli.run(call)))
    thread.start()
    thread.join()
    assert codes == [0]


def test_progress_is_drawn_on_a_terminal_and_nowhere_else(deglint, sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    call = ["remove", source, str(tmp_path / "out.tif"), *RUN, "--overwrite"]
    assert "\r" not in deglint(*call).err
    terminal, end = pty.openpty()
    done = subprocess.run([sys.executable, "-m", "deglint", *call], stdout=subprocess.PIPE, stderr=end, check=False)
    os.close(end)
    said = b""
    while chunk := _read(terminal):
        said += chunk
    os.close(terminal)
    assert (done.returncode, done.stdout) == (0, b"")
    assert b"correct  [##############################] 100 %" in said
    assert b"pixels corrected" in said


def _read(terminal):
    try:
        return os.read(terminal, 4096)
    except OSError:
        return b""


def test_a_reader_that_leaves_is_no_fault(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    line = f"'{sys.executable}' -m deglint info '{source}' --json | true"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False)
    assert done.stderr == ""


def test_a_closed_stderr_is_no_fault(sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    line = f"'{sys.executable}' -m deglint remove '{source}' '{tmp_path}/out.tif' {' '.join(RUN)} 2>&-"
    assert subprocess.run(["bash", "-c", line], stdout=subprocess.DEVNULL, check=False).returncode == 0


def test_a_dry_run_with_a_model_refuses_a_scene_without_its_bands(deglint, sea, write, tmp_path):
    source, model = write(tmp_path / "a.tif", sea()), tmp_path / "m.json"
    ran = deglint("remove", source, tmp_path / "o.tif", "--method", "hedley", "--save-model", model, "--sample", "all")
    assert ran.code == 0, ran.err
    turned = write(tmp_path / "b.tif", sea()[::-1], names=("nir", "red", "green", "blue"))
    assert "reference bands: nir" in deglint("remove", turned, tmp_path / "p.tif", "--model", model, "--dry-run").out
    fewer = write(tmp_path / "c.tif", sea()[:3], names=("blue", "green", "red"))
    ran = deglint("remove", fewer, tmp_path / "p.tif", "--model", model, "--dry-run")
    assert ran.code == 1
    assert "nir" in ran.err
    assert "a bug in" not in ran.err
