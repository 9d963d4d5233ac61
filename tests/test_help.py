"""What a newcomer meets on the command line: groups and examples in help, completion, dry runs."""

import json

import numpy as np
import pytest
import rasterio

from deglint import cli
from detect import cli as detect_cli

from .common import RUN

EVERY = [(p.cli, n) for p in (cli, detect_cli) for n in p.COMMANDS]


@pytest.mark.parametrize(("program", "name"), EVERY, ids=[name for _, name in EVERY])
def test_every_command_has_an_example(program, name):
    command = program.get_command(None, name)
    assert f" {name} " in command.help


def test_help_of_the_judging_commands_is_in_groups(rxdetect):
    for call in (("roc",), ("bench",)):
        ran = rxdetect(*call, "--help")
        assert ran.code == 0
        assert "\nWhat to do:\n" in ran.out
        assert "\nMessages:\n" in ran.out


@pytest.mark.parametrize(
    ("program", "words", "found"),
    [("deglint", "deglint re", ["plain,remove"]), ("deglint", "deglint remove in.tif --meth", ["plain,--method"]),
     ("deglint", "deglint remove --method he", ["plain,hedley"]), ("deglint", "deglint remove sce", ["file,sce"]),
     ("deglint", "deglint info --sensor sentinel", ["plain,sentinel2", "file,sentinel"]),
     ("rxdetect", "rxdetect score --mask w", ["plain,water", "file,w"])],
)  # fmt: skip
def test_a_shell_completes_commands_options_values_and_files(request, monkeypatch, program, words, found):
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    monkeypatch.setenv(f"_{program.upper()}_COMPLETE", "bash_complete")
    ran = request.getfixturevalue(program)()
    assert (ran.code, ran.out.split(), ran.err) == (0, found, "")


def test_no_colour_leaves_the_program_where_there_is_no_terminal(deglint):
    ran = deglint("remove", "none.tif", "out.tif")
    assert ran.err.startswith("Error: no such file")
    assert "\x1b" not in deglint("remove", "--help").out


def test_a_dry_run_fits_and_writes_nothing(deglint, sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    call = ("remove", source, tmp_path / "out.tif", *RUN, "--flags", tmp_path / "flags.tif", "--dry-run", "-q")
    ran = deglint(*call)
    assert (ran.code, ran.err) == (0, "")
    sizes = "out.tif (64 kB)", "flags.tif (16 kB)"
    for said in (
        "80 x 100 pixels, bands blue",
        "reference bands: nir",
        "options: --method hedley --sample all --mask none",
        *sizes,
    ):
        assert said in ran.out
    found = json.loads(deglint(*call, "--json", "--dtype", "float32").out)
    assert found["files"][str(tmp_path / "out.tif")] == 4 * 4 * 8000
    assert [p.name for p in tmp_path.iterdir()] == ["in.tif"]
    (tmp_path / "out.tif").touch()
    assert "--overwrite" in deglint(*call).err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--compensate", "remove, identify-level:9, replace-level", "--stderr", "s.tif"), "needs identify-level"),
        (("--model", "m.json", "--save-sample", "s.geojson"), "was not fitted to a sample"),
    ],
)
def test_a_dry_run_refuses_what_the_run_refuses(deglint, sea, write, tmp_path, monkeypatch, options, said):
    monkeypatch.chdir(tmp_path)
    call = ("remove", write(tmp_path / "in.tif", sea()), "out.tif")
    assert deglint(*call, *RUN, "--save-model", "m.json").code == 0
    fit = () if "--model" in options else RUN
    for dry in ((), ("--dry-run",)):
        ran = deglint(*call, *fit, *options, "--overwrite", *dry)
        assert (ran.code, ran.err.count("\n")) == (1, 1)
        assert said in ran.err


@pytest.mark.parametrize("options", [("--compensate", "thesis", "--amount"), ("--stderr",)])
def test_a_dry_run_counts_the_bands_of_each_output(deglint, sea, write, tmp_path, monkeypatch, options):
    monkeypatch.chdir(tmp_path)
    call = ("remove", write(tmp_path / "in.tif", sea()), "out.tif", *RUN, *options, "more.tif")
    sizes = json.loads(deglint(*call, "--dry-run", "--json", "-q").out)["files"]
    assert deglint(*call).code == 0
    for name in ("out.tif", "more.tif"):
        with rasterio.open(name) as made:
            assert sizes[name] == made.count * made.width * made.height * np.dtype(made.dtypes[0]).itemsize


def test_a_dry_run_of_a_batch_counts_bytes(deglint, sea, write, tmp_path):
    write(tmp_path / "in.tif", sea())
    (tmp_path / "recipe.toml").write_text("")
    ran = deglint("batch", tmp_path / "recipe.toml", tmp_path / "*.tif", "--dry-run")
    assert ran.out.endswith("would read and write 64 kB of pixels before compression\n")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(("remov", "a.tif", "b.tif"), "Did you mean remove?"),
     (("scene.tif", "out.tif"), "The commands are remove, batch")],
)  # fmt: skip
def test_a_wrong_command_is_answered_with_the_right_ones(deglint, arguments, said):
    ran = deglint(*arguments)
    assert (ran.code, said in ran.err) == (2, True), ran.err


def test_an_output_has_the_ending_of_what_it_holds(deglint, rxdetect, sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    for option, name, right in (
        ("--picture", "p.jpg", "p.png"),
        ("--flags", "flags.png", "flags.tif"),
        ("--save-sample", "s.shp", "s.geojson"),
        ("--save-model", "m.tif", "m.json"),
    ):
        for dry in ((), ("--dry-run",)):
            ran = deglint("remove", source, tmp_path / "out.tif", *RUN, option, tmp_path / name, *dry)
            assert (ran.code, f"Name it {right}." in ran.err) == (1, True), ran.err
    for program, command in ((deglint, "remove"), (rxdetect, "score")):
        ran = program(command, source, tmp_path / "in.tif.json")
        assert (ran.code, "Name it in.tif.tif." in ran.err) == (1, True), ran.err
    ran = rxdetect("roc", source, source, "--report", tmp_path / "roc.pdf")
    assert (ran.code, "Name it roc.html." in ran.err) == (1, True), ran.err


def test_info_says_nothing_twice(deglint, sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea(), names=("B02", "B03", "B04", "B08"))
    said = [line.strip() for line in deglint("info", source).out.splitlines() if line]
    assert len(said) == len(set(said))
