"""The benchmarks run and print tables; what they print is looked at by people."""

import re
import subprocess
import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio

from benchmarks import ablation, floor, harbours, peers, scenes, seas, size, timing, uncertainty, varied
from benchmarks.processes import in_turns
from deglint import open_scene
from deglint.choose import Candidate, Choice, Trial
from deglint.compensate import background
from deglint.pipeline import sample
from deglint.raster.simulated import write_scene
from deglint.remove import wiener
from deglint.simulate import simulate

from .common import ROOT, beside


def printed(*arguments):
    """What `python -m ...` prints from the repository's root."""
    done = subprocess.run([sys.executable, "-m", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def rows(text):
    """Cells of every table row, by its first cell."""
    cells = [[c.strip() for c in line.strip("| ").split("|")] for line in text.splitlines() if line.startswith("| ")]
    return {row[0]: row[1:] for row in cells}


@pytest.mark.slow
@beside("simulated")
def test_errors_are_those_recorded():
    text = printed("benchmarks", "error", "--quick")
    published = rows(text)["recorded: hedley ols"]
    assert re.search(r"\| hedley ols +\| polygon +\| " + r" +\| ".join(published[1:]), text)
    recorded = re.findall(r"\| wind\d+_delay\d+ +\| (?:hedley|lyzenga|joyce) +\| (\S+) +\| (\S+) +\|", text)
    assert len(recorded) == 6
    for ours, theirs in recorded:
        assert float(ours) == pytest.approx(float(theirs), rel=0.005)


def test_children_are_measured_in_turns_and_failures_told(tmp_path):
    note = f"open({str(tmp_path / 'out.txt')!r}, 'x').close(); open({str(tmp_path / 'log')!r}, 'a').write"
    hold = "b = bytearray(200 << 20); b[::4096] = b'1' * len(b[::4096])"
    found = in_turns(
        {
            "one": [sys.executable, "-c", f"{note}('1')"],
            "two": [sys.executable, "-c", "1 / 0"],
            "three": [sys.executable, "-c", f"{note}('3'); {hold}"],
            "none": [str(tmp_path / "no program")],
        },
        2,
        [str(tmp_path / "out.t*")],
    )
    assert (tmp_path / "log").read_text() == "1313"
    assert not (tmp_path / "out.txt").exists()
    assert found["two"] == "ZeroDivisionError: division by zero"
    assert "cannot start" in found["none"]
    assert all(r.peak > 200 for r in found["three"])
    assert all(r.written == 1 and r.read > 1000 for r in found["one"]) or not Path("/proc/self/io").exists()
    assert all(r.peak < 100 for r in found["one"]), "the memory of their parent is not theirs"


def test_a_sea_is_the_same_every_time_and_so_is_its_copy(tmp_path):
    a, b, copied = (tmp_path / name for name in ("a.tif", "b.tif", "copied.tif"))
    for path in (a, b):
        seas.write_sea(path, 300)
    floor.copy(str(a), str(copied))
    with rasterio.open(a) as one, rasterio.open(b) as two, rasterio.open(copied) as three:
        assert one.descriptions[6] == "NIR1"
        np.testing.assert_array_equal(one.read(), two.read())
        np.testing.assert_array_equal(one.read(), three.read())
        assert three.profile["compress"] == "deflate"


def test_other_programs_score_what_we_score():
    block, inside = peers.image(5, 24), slice(10, -10)  # at the edges programs shift or cut their windows
    for window in (None, peers.TIMED_WINDOW):
        jobs = peers.jobs_of(block, window).values()
        mine, *others = (np.asarray(job()).reshape(24, 24)[inside, inside] for job in jobs)
        for theirs in others:
            np.testing.assert_allclose(theirs, mine, rtol=3e-3)  # n or n - 1


def test_sizes_of_rooms_and_of_what_is_too_large():
    long = "def f(self, a, b, c, d, e, f, g, h):\n" + '    """Doc.\n\n    More.\n    """\n' + "    a = 1\n" * 60
    found = {"deglint/moments.py": "x = 1\n", "deglint/pipeline/run.py": long, "detect/bench/run.py": "\n" * 401,
             "detect/global_rx.py": "\n" * 2, "benchmarks/big.py": long}  # fmt: skip
    lines = size.sizes(found)
    assert (lines["foundations"], lines["pipeline, batch"], lines["detect/bench"], lines["detect"]) == (1, 65, 401, 2)
    modules, functions, parameters = (rows for _, _, rows in size.too_large(found))
    assert modules == [["detect/bench/run.py", "401"]]
    assert functions == [["deglint/pipeline/run.py: f", "65", "61"]]
    assert parameters == [["deglint/pipeline/run.py: f", "8"]]


def test_every_room_is_counted_once():
    found = size.modules(ROOT)
    assert sum(size.sizes(found).values()) == sum(text.count("\n") for text in found.values())
    assert "detect/bench/run.py" in found


@pytest.mark.slow
def test_plan():
    table = rows(printed("benchmarks", "plan", "--quick"))
    assert {"reticle", "answer of the page", "deglint plan -o plan.png"} <= set(table)


def test_the_model_of_scale_is_a_line_through_what_was_measured(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))
    from benchmarks import scale

    def run(side):
        values = 8 * side**2 / 1e6
        return {"cpu": 2 + 0.03 * values, "wall": 1, "peak": 200, "read": 1.5e6 * values, "size": 0.5e6 * values}

    runs = {f"{what} {side}": run(side) for what in scale.COMMANDS for side in (1024, 8192)}
    runs["score 16384"] = {"stopped": "the disk has 1 GB left"}
    found = {"machine": "a machine.", "runs": runs}
    line = scale.line_of(found, "score")
    assert line["slope"] == pytest.approx(0.03)
    assert line["start"] == pytest.approx(2)
    text = "\n\n".join(scale.tables(found))
    assert "the disk has 1 GB left" in text
    hours = (73 * 2 + 73 * 10980**2 * 4 / 1e6 * 0.03) / 60
    assert f"{hours:.3g} min" in text


def test_measured_parts_of_a_page_are_replaced(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"a\n\n{timing.PART_MARK}\n\nold\n\n{timing.PART_MARK}\n\nb\n")
    timing.fill(page, ["new"])
    assert page.read_text() == f"a\n\n{timing.PART_MARK}\n\nnew\n\n{timing.PART_MARK}\n\nb\n"
    with pytest.raises(ValueError, match=r"page\.md needs .* each of 2 parts"):
        timing.fill(page, ["one", "two"])
    pages = {"benchmark": 1, "evidence-detection": 4, "field": 4, "scale-model": 4}
    assert {n: (ROOT / "docs" / f"{n}.md").read_text().count(timing.PART_MARK) // 2 for n in pages} == pages


def choice(*chains, best=-1):
    """Candidates of these chains, one of them chosen."""
    tried = [Candidate(chain, "wiener", chain) for chain in chains]
    return Choice(tried[best], tuple(Trial(c, (), {}) for c in tried))


OPENED = "psf:2, identify-level:13, targets, replace-level, remove"


def test_pieces_are_dropped_from_the_chosen_chain():
    found = choice("off", OPENED, "targets, remove, posterior")
    assert ablation.without("targets", choice(OPENED)) == ("wiener", OPENED.replace("targets, ", ""))
    assert ablation.without("psf", choice(OPENED)) == ("wiener", OPENED.replace("psf:2, ", ""))
    assert ablation.without("posterior", choice("remove, posterior")) == ("wiener", "off")
    assert ablation.opened(found) == ("wiener", OPENED)
    assert ablation.opened(choice("off")) == ("wiener", "off")
    no_file = scenes.Known(Path("none"), *[np.zeros(1)] * 3, ())
    for name in ("psf", "outlines", "ringing", "second window"):
        assert ablation.ratio(ablation.PIECES[name], no_file, found, 1.0) == 1, "not in what was chosen, so not run"


@pytest.mark.parametrize("name", [n for n, p in ablation.PIECES.items() if p.change is not nullcontext])
def test_pieces_are_replaced_for_a_while(name):
    homes = background, sample, wiener, ablation.CANDIDATES
    before = [dict(vars(home)) for home in homes]
    with ablation.PIECES[name].change():
        differ = [
            k for home, was in zip(homes, before, strict=True) for k, v in vars(home).items() if was.get(k) is not v
        ]
        assert len(differ) == 1
    assert [dict(vars(home)) for home in homes] == before


def test_scenes_have_errors_where_pixels_count(tmp_path, monkeypatch):
    monkeypatch.setattr(scenes, "DATA", tmp_path)
    monkeypatch.setattr(scenes, "OWN", ())
    said = []
    assert list(scenes.scenes(quick=False, say=said.append)) == []
    assert len(said) == 2
    options = {"driver": "GTiff", "height": 4, "width": 4, "dtype": "float32"}
    for name, values in (("s", (3, 9)), ("s_truth", (2, 9)), ("s_mask", (0, 1))):
        with rasterio.open(tmp_path / f"{name}.tif", "w", count=2, **options) as out:
            out.write(np.multiply.outer(np.array(values, np.float32), np.ones((4, 4), np.float32)))
            out.update_tags(**({"level": "[4, 1]"} if name == "s_mask" else {}))
    known = scenes.Known.of(tmp_path / "s.tif")
    assert known.visible == (0,)
    assert known.error(np.full((2, 4, 4), 3.0)) == pytest.approx(25)
    claimed = {0: np.full((4, 4), 0.5, np.float32)}
    assert uncertainty.ratio(known, np.full((2, 4, 4), 3.0), claimed, [0]) == "-", "too few pixels"
    monkeypatch.setattr(uncertainty, "LEAST_PIXELS", 16)
    assert uncertainty.ratio(known, np.full((2, 4, 4), 3.0), claimed, [0]) == "0.50 (25.0 %)"


@pytest.mark.slow
def test_scenes_drawn_at_random_are_the_same_every_time_and_say_what_they_are():
    setups = [varied.drawn(n) for n in range(varied.COUNT)]
    assert setups == [varied.drawn(n) for n in range(varied.COUNT)]
    said = ", ".join(varied.described(s) for s in setups)
    assert all(
        word in said for word in ("bottom", "coast", "foam", "boats", "misregistered", "striped", "JPEG", "cubic")
    )


def test_targets_are_planted_in_a_copy_of_a_file(tmp_path, write):
    source = write(tmp_path / "sea.tif", np.full((3, 9, 9), 100, np.uint16))
    there = harbours._planted(source, tmp_path / "copy.tif", [(slice(2, 4), slice(5, 6))], 900)
    assert [(band > 100).sum() for band in there] == [2, 2, 2]
    assert harbours.values(source).max() == 100


def test_what_is_kept_of_floating_targets_is_their_contrast():
    truth, afloat = np.full((2, 4, 4), 2.0), np.zeros((4, 4), bool)
    afloat[1, 1] = True
    truth[:, 1, 1] = 10.0
    known = scenes.Known(Path("s.tif"), truth, np.array([2.0, 2.0]), ~afloat, (0,))
    half = np.where(afloat, 6.0, 2.0)[None].repeat(2, axis=0)
    assert varied.kept(known, truth, afloat) == 1
    assert varied.kept(known, half, afloat) == 0.5


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "wind", "delay"), [("disc", 9.0, 0.06), ("diamond", 9.0, 0.06), ("disc", 5.0, 0.0)])
def test_objects_of_four_metres_are_kept(tmp_path, kind, wind, delay):
    """None of them holds a square of 13 pixels."""
    known = scenes.Known.of(scenes.Case(wind, delay, seed=7, kinds=(kind,)).written(tmp_path))
    assert known.error(open_scene(known.path).read()) > 20
    assert known.error(scenes.deglinted(known.path)[0]) < 6.5


@pytest.mark.slow
def test_discs_come_to_no_harm_where_flashes_are_rare(tmp_path):
    """Across the sun at 5 m/s, simultaneous bands."""
    made = scenes.Case(5, 0.0, seed=3, kinds=("disc",)).setup
    write_scene(simulate(replace(made, view_zenith=40.0, view_azimuth=made.sun_azimuth + 90)), tmp_path / "discs")
    known = scenes.Known.of(tmp_path / "discs.tif")
    assert known.error(open_scene(known.path).read()) > 15
    assert known.error(scenes.deglinted(known.path)[0]) < 4.5


def test_modules_functions_and_the_product_are_within_their_limits():
    found = size.modules()
    assert [(title, rows) for title, _, rows in size.too_large(found) if rows] == []
    assert sum(text.count("\n") for path, text in found.items() if not path.startswith("benchmarks/")) <= size.TOTAL
