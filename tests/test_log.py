"""What is logged, when, and how a command shows it."""

import json
import logging

import pytest
from rasterio.transform import Affine, from_origin

import deglint
from deglint import Recipe, timing
from deglint.cli.running import Console
from deglint.pipeline.messages import log_scene

from .common import RUN, says


def test_decisions_are_logged_before_the_work(sea, write, tmp_path, caplog):
    source, at_work = write(tmp_path / "in.tif", sea()), []

    def progress(stage, done, total):
        if stage == "correct" and not at_work:
            at_work.extend(caplog.messages)

    with caplog.at_level(logging.INFO, "deglint"):
        deglint.remove_glint(source, tmp_path / "out.tif", Recipe(method="hedley"), progress=progress)
    for begin in (f"{source}: 4 bands, 100 x 80 pixels", "NIR is band 4 nir", "water: ",
                  "compensation: ", "sample: ", "method: hedley; bands to correct: blue, green, red"):  # fmt: skip
        assert any(line.startswith(begin) for line in at_work), begin
    after = caplog.messages[len(at_work) :]
    assert says(after[0], "changed: blue, green, red", "copied: nir")
    assert "pixels corrected" in after[-1]
    assert all(record.name.partition(".")[0] == "deglint" for record in caplog.records)


def test_band_delays_are_logged(write, sea, tmp_path, caplog):
    def delays(dataset):
        for i in range(4):
            dataset.update_tags(i + 1, time_offset_s=str(0.09 * i))

    scene = deglint.open_scene(write(tmp_path / "in.tif", sea(), describe=delays))
    assert scene.bands[3].time_offset == pytest.approx(0.27)
    with caplog.at_level(logging.INFO, "deglint"):
        deglint.examine(scene)
    assert says(caplog.text, "band delays read from file", "270 ms")
    for own, source in ((delays, "read from file"), (None, "known for sentinel2")):  # the delays of the file count
        caplog.clear()
        path = write(tmp_path / "b.tif", sea(), names=("B02", "B03", "B04", "B08"), describe=own)
        with caplog.at_level(logging.INFO, "deglint"):
            log_scene(deglint.open_scene(path, sensor="sentinel2"))
        assert says(caplog.text, f"band delays {source}")


@pytest.mark.parametrize(
    ("options", "shown", "hidden"),
    [((), "NIR is band 4", "R2"), (("-v",), "R2", "Traceback"), (("-q",), "", "NIR")],
)
def test_a_command_shows_as_much_as_it_is_asked_for(options, shown, hidden, deglint, sea, write, tmp_path):
    source = write(tmp_path / "in.tif", sea())
    ran = deglint("remove", source, tmp_path / "out.tif", *RUN, "--compensate", "off", *options)
    assert (ran.code, ran.out) == (0, "")
    assert shown in ran.err
    assert hidden not in ran.err
    assert (ran.err == "") == ("-q" in options)
    assert not any(isinstance(h, Console) for h in logging.getLogger("deglint").handlers)


def test_a_band_on_another_grid_is_shown(deglint, sea, write, tmp_path):
    raw, corner = sea(), from_origin(4e5, 8e5, 10, 10)
    fine = write(tmp_path / "a_green.tif", raw[1:2], names=["green"], transform=corner)
    coarse = write(tmp_path / "a_nir.tif", raw[3:, ::2, ::2], names=["nir"], transform=corner @ Affine.scale(2))
    assert "to the grid of" in deglint("remove", fine, coarse, tmp_path / "out.tif", *RUN).err


def test_errors_are_all_that_quiet_shows(deglint, sea, write, tmp_path):
    ran = deglint("remove", write(tmp_path / "in.tif", sea()), tmp_path / "out.tif", "-b", "purple", "-q")
    assert ran.code == 1
    assert ran.err.startswith("Error: no band 'purple'")
    assert ran.err.count("\n") == 1


def test_scores_are_logged(rxdetect, sea, write, tmp_path):
    ran = rxdetect("score", write(tmp_path / "in.tif", sea()), tmp_path / "out.tif", "--method", "rx", "--json")
    assert json.loads(ran.out)["pixels"]
    lines = ran.err.splitlines()
    assert lines[0].endswith("in.tif: 4 bands, 100 x 80 pixels")
    assert lines[1].startswith("rx on 4 bands")
    assert "8000 of 8000 pixels scored" in lines[-1]


@pytest.mark.slow
def test_a_batch_passes_on_what_its_workers_log(deglint, sea, write, tmp_path):
    order = tmp_path / "order.toml"
    order.write_text(f'[recipe]\nmethod = "hedley"\n[output]\ndirectory = "{tmp_path}/clean"\n')
    ran = deglint("batch", order, write(tmp_path / "one.tif", sea()), "-v")
    assert ran.code == 0
    assert says(ran.err, "one: ", "band 4 nir", "840 nm")
    assert "[1/1] one done in " in ran.err


def test_without_a_handler_nothing_is_printed(sea, write, tmp_path, capfd):
    deglint.remove_glint(write(tmp_path / "in.tif", sea()), tmp_path / "out.tif", Recipe(method="hedley", mask="none"))
    assert capfd.readouterr() == ("", "")


def test_time_left_follows_from_the_tiles_that_are_finished(monkeypatch, caplog):
    clock = iter([0.0, 10.0, 10.0, 50.0, 50.0, 50.0, 60.0, 60.0, 99.0, 99.0])
    monkeypatch.setattr(timing.time, "monotonic", lambda: next(clock))
    report = timing.Reporter()
    with caplog.at_level(logging.INFO, "deglint"):
        for done in (1, 2, 5, 6, 10):
            report("correct", done, 10)
    assert caplog.messages == ["correct: 50 %, 62 s left"]


def test_a_progress_line_makes_room_for_the_log(monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with Console({}) as console:
        console.progress("fit", 1, 4)
        logging.getLogger("deglint.pipeline").info("a line")
        console.progress("fit", 4, 4)
    said = capsys.readouterr().err
    assert said.startswith("\r\x1b[Kfit      [#######")
    assert "\r\x1b[Ka line\n" in said
    assert said.endswith("100 %\r\x1b[K")
