"""The benchmark's frame, with experiments that are not there: page, JSON, comparison, failures, what is left behind."""

import importlib
import importlib.util
import json
import math
import re
import sys
import types
import xml.etree.ElementTree as ET
from importlib.machinery import ModuleSpec
from pathlib import Path

import numpy as np
import pytest

import detect.bench
from detect.bench import EXPERIMENTS, collect, compare, markdown, report
from detect.bench.section import Effort, Figure, Number, Section, Table, over_seeds, timed
from detect.report import svg

_spec = importlib.util.spec_from_file_location("roc_report_tests", Path(__file__).with_name("test_roc_report.py"))
_pages = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(_pages)
Page = _pages.Page
EVIL = "a<script>alert(1)<&'\">|b*"


def section(name, factor=1.0, **extra):
    """A chapter of everything that chapters may hold."""
    x = np.arange(2, 13.0)
    lines = [svg.Series(EVIL, x, x), svg.Series("joyce", x, 2 * x)]
    axes = svg.Axis("wind [m/s]", 2, 12), svg.Axis(EVIL, 1, 30, log=True)
    small = Figure(f"Small {EVIL}", svg.plot(lines, *axes, title=EVIL, size=svg.HALF, legend=True), EVIL)
    wide = Figure("Wide", svg.plot(lines, *axes, title="Wide", legend=True))
    numbers = {
        f"{name}/wind09/joyce/rms": over_seeds([4.0 * factor, 4.2 * factor, 4.4 * factor], "%"),
        f"{name}/digits": Number(13.0 * factor, better="higher"),
        f"{name}/cpu": timed([1.0 * factor, 1.1 * factor, 1.2 * factor]),
        f"{name}/ratio": timed([2.0 * factor, 2.02 * factor, 2.04 * factor], ""),
        f"{name}/nothing": Number(math.nan),
        f"{name}/endless": Number(math.inf),
    }
    rows = [
        (EVIL, numbers[f"{name}/wind09/joyce/rms"], 12345, 1e-7, math.nan),
        ("joyce", numbers[f"{name}/cpu"], 1, 2.5, 3),
    ]
    table = Table.of(f"Table {EVIL}", ("method", EVIL, "pixels", "p", "x"), rows, EVIL)
    part = Section(f"{name}/part", "A part", ("Words.",), (table,), (), {"loose": Number(1.0)})
    return Section(name, f"Title {EVIL}", (f"Words {EVIL}.",), (table,), (small, small, wide), numbers, (part,),
                   **({"finding": f"Found {EVIL}."} | extra))  # fmt: skip


@pytest.fixture
def experiments(monkeypatch):
    """Set the experiments: experiments(thesis=function of effort, ...); what is not given is not installed."""

    def put(**runs):
        for name in EXPERIMENTS:
            module = types.ModuleType(f"detect.bench.{name}")
            module.__spec__ = ModuleSpec(module.__name__, None)
            module.run = runs.get(name)
            monkeypatch.setitem(sys.modules, module.__name__, module)
        monkeypatch.setattr(detect.bench, "present", lambda: tuple(n for n in EXPERIMENTS if n in runs))

    return put


@pytest.fixture
def rxdetect(command, tmp_path, monkeypatch):
    """Run the command in this process and in a directory of its own."""
    from detect.cli import run

    monkeypatch.chdir(tmp_path)
    return command(run)


def fail(_effort):
    raise ValueError(f"no scene\nfits {EVIL}")


def test_page_is_whole_fetches_nothing_and_escapes_every_name(experiments, rxdetect, tmp_path):
    experiments(thesis=lambda _: section("thesis"), stress=fail, peers=lambda _: section("peers"))
    ran = rxdetect("bench", "--quick")
    assert ran.code == 1
    assert "stress failed: ValueError: no scene fits" in ran.err
    text = (tmp_path / "benchmark.html").read_text(encoding="utf-8")
    parsed = Page(text)
    assert parsed.faults == []
    assert parsed.open == []
    targets = set(re.findall(r'id="([^"]+)"', text))
    assert parsed.links
    assert all(link.startswith("#") and link[1:] in targets for link in parsed.links)
    assert "<script" not in text
    said = " ".join(parsed.text)
    for word in (
        EVIL,
        "stress failed",
        "rxdetect bench benchmark.html --quick --seeds 2",
        "numpy",
        "12,345",
        "Contents",
    ):
        assert word in said
    assert said.index("Found") < said.index("Contents") < said.index("How this was made") < said.index("Words")


def test_json_holds_every_number_and_no_nan(experiments, rxdetect, tmp_path):
    experiments(thesis=lambda _: section("thesis"), stress=fail)
    rxdetect("bench", "out.html", "--json", "numbers.json", "--seeds", 3)

    def refuse(word):
        raise AssertionError(word)

    data = json.loads((tmp_path / "numbers.json").read_text(), parse_constant=refuse)
    assert data["failed"] == {"stress": f"ValueError: no scene fits {EVIL}"}
    assert data["made"]["seeds"] == 3
    assert set(data["made"]["experiments"]) == {"thesis", "stress"}
    assert data["made"]["machine"]["cores"] >= 1
    expected = section("thesis").every_number()
    assert set(data["numbers"]) == {n if n.startswith("thesis/") else f"thesis/{n}" for n in expected}
    assert data["numbers"]["thesis/nothing"]["value"] is None
    assert data["numbers"]["thesis/endless"]["value"] is None
    one = data["numbers"]["thesis/wind09/joyce/rms"]
    assert list(one) == ["value", "low", "high", "unit", "better", "exact"]
    back = compare.Run.of("x", data).numbers["thesis/wind09/joyce/rms"]
    assert back == expected["thesis/wind09/joyce/rms"]


def test_outputs_are_not_replaced_and_nothing_is_measured_in_vain(experiments, rxdetect, tmp_path):
    calls = []
    experiments(thesis=lambda effort: calls.append(effort) or section("thesis"))
    (tmp_path / "benchmark.html.json").write_text("mine")
    ran = rxdetect("bench")
    assert ran.code == 1
    assert "--overwrite" in ran.err
    assert not calls
    assert (tmp_path / "benchmark.html.json").read_text() == "mine"
    assert rxdetect("bench", "--overwrite", "-q") == (0, "", "")
    assert calls[0].quick is False
    assert calls[0].seeds == 5
    assert rxdetect("bench", "a.html", "--json", "a.html").code == 2
    assert rxdetect("bench", "nowhere/a.html").code == 1
    assert rxdetect("bench", "b.html", "--scratch", "nowhere").code == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["benchmark.html", "benchmark.html.json"]


def test_interrupted_it_leaves_nothing(experiments, rxdetect, tmp_path):
    places = []

    def interrupted(effort):
        places.append(effort.directory)
        (effort.directory / "scene.tif").write_text("large")
        raise KeyboardInterrupt

    experiments(thesis=lambda _: section("thesis"), stress=interrupted)
    (tmp_path / "scratch").mkdir()
    ran = rxdetect("bench", "--scratch", "scratch")
    assert ran.code == 130
    assert "nothing was written" in ran.err
    assert places[0].parent.resolve() == (tmp_path / "scratch").resolve()
    assert [p.name for p in tmp_path.rglob("*")] == ["scratch"]


def test_only_some_experiments(experiments, rxdetect, tmp_path):
    experiments(thesis=fail, stress=lambda _: section("stress"), peers=lambda _: section("peers"))
    assert rxdetect("bench", "--only", "peers,stress", "-q").code == 0
    made = json.loads((tmp_path / "benchmark.html.json").read_text())["made"]
    assert list(made["experiments"]) == ["stress", "peers"]
    assert "--only peers,stress" in made["command"]
    ran = rxdetect("bench", "--only", "speed")
    assert ran.code == 2
    assert "there are thesis, stress, peers" in ran.err


def test_the_trace_of_a_failure_is_shown_on_demand(experiments, rxdetect):
    experiments(stress=fail)
    assert "Traceback" not in rxdetect("bench").err
    assert "Traceback" in rxdetect("bench", "--overwrite", "-vv").err


def test_a_package_that_is_missing_is_said_with_its_remedy(experiments, rxdetect):
    experiments(stress=lambda _: importlib.import_module("no_such_package"))
    assert "No module named 'no_such_package'. Install what the benchmark needs: pip" in rxdetect("bench").err


def test_documentation_is_remade_between_its_marks(experiments, rxdetect, tmp_path):
    experiments(thesis=lambda _: section("thesis"))
    docs = tmp_path / "docs"
    docs.mkdir()
    (docs / "benchmark.md").write_text(f"# Mine\n\n{markdown.BEGIN}\nold\n{markdown.END}\n\nAfter.\n")
    (docs / "benchmark").mkdir()
    (docs / "benchmark" / "old.svg").write_text("<svg/>")
    (docs / "other.svg").write_text("<svg/>")
    assert rxdetect("bench", "--docs", "docs", "-q").code == 0
    text = (docs / "benchmark.md").read_text(encoding="utf-8")
    assert text.startswith("# Mine\n")
    assert text.endswith("After.\n")
    assert "\nold\n" not in text
    assert "<script" not in text.replace("\\<script", "")
    assert re.search(r"\| joyce \| 1\.1\d* \(1\.0\d*-1\.2\d*\) \| 1 \| 2\.5 \| 3 \|", text)
    figures = {f"benchmark/{p.name}" for p in (docs / "benchmark").iterdir()}
    assert figures == set(re.findall(r"\((benchmark/[^)]*\.svg)\)", text))
    assert len(figures) == 3
    assert (docs / "other.svg").exists()
    for name in figures:
        assert ET.parse(docs / name).getroot().tag == "{http://www.w3.org/2000/svg}svg"
    assert rxdetect("bench", "--docs", "docs", "--only", "thesis", "--overwrite").code == 2
    (docs / "benchmark.md").write_text("no marks")
    ran = rxdetect("bench", "--docs", "docs", "--overwrite")
    assert ran.code == 1
    assert markdown.BEGIN in ran.err
    experiments(thesis=fail)
    assert "left as it was" in rxdetect("bench", "--docs", "docs", "--overwrite").err


def test_effort_and_sections():
    effort = Effort(True, 2, Path())
    assert (effort.threads, effort.peers) == (2, "")
    number = over_seeds([1.0, 2.0, 3.0])
    assert number.value == 2
    assert number.high - 2 == pytest.approx(4.302652729911275 / math.sqrt(3))  # t of 2 degrees of freedom, tables
    assert number.low == pytest.approx(4 - number.high)
    assert math.isnan(over_seeds([1.0]).low)
    assert timed([3.0, 1.0, 2.0]) == Number(2.0, "s", 1.0, 3.0, "lower", exact=False)
    assert timed([4.0, 1.0, 2.0, 3.0]).value == 2.5
    assert str(Number(1.2345)) == "1.23"
    assert str(number) == f"2 ({number.low:.3g}-{number.high:.3g})"
    assert list(section("x").every_number())[-1] == "loose"
    with pytest.raises(ValueError, match="longer than its head of 1"):
        Table.of("T", ("a",), [(1, 2)])
    found = collect.Collected((section("x"),))
    assert "x/loose" in found.numbers()


@pytest.mark.parametrize(
    ("number", "middle", "span"),
    [
        (Number(4.8779, low=3.3011, high=6.4547), "4.9", "3.3&ndash;6.5"),
        (Number(0.98765, low=0.98761, high=0.98769), "0.9877", "0.9876&ndash;0.9877"),
        (Number(1552.3, low=1500.0, high=1600.0), "1,552", "1,500&ndash;1,600"),
        (Number(-1.0, low=-1.5, high=-0.5), "&minus;1.00", "&minus;1.50 to &minus;0.50"),
        (Number(1.0, low=1.0, high=1.0), "1", ""),
        (Number(1e-9, low=0.0, high=2e-9), "10<sup>&minus;9</sup>", ""),
        (Number(math.nan), "&ndash;", ""),
    ],
)
def test_no_more_digits_are_shown_than_are_certain(number, middle, span):
    assert report.shown(number) == (middle, span)


def run_of(numbers, **made):
    """A benchmark that was read back."""
    base = {"machine": {"processor": "p", "cores": 2}, "quick": False, "seeds": 5, "versions": {"deglint": "1"},
            "experiments": {"a": 1.0}}  # fmt: skip
    return compare.Run("x.json", base | made, numbers, {})


def verdict(old, new, **made):
    found = compare.compare(run_of({"a/n": old}), run_of({"a/n": new}, **made))
    return found.changes[0].verdict if found.changes else next(k for k, v in found.counts.items() if v)


def of(value, half=math.nan, **extra):
    return Number(value, low=value - half, high=value + half, **extra)


def cost(value, half, unit, better="lower"):
    return of(value, half, unit=unit, better=better, exact=False)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (of(5, 1, better="lower"), of(8, 1, better="lower"), "worse"),
        (of(5, 1, better="lower"), of(2, 0.5, better="lower"), "better"),
        (of(5, 1, better="higher"), of(8, 1, better="higher"), "better"),
        (of(5, 1), of(8, 1), "changed"),
        (of(5, 1, better="lower"), of(6, 1, better="lower"), "changed"),
        (of(5, 1, better="lower"), of(5 + 1e-7, 1, better="lower"), "same"),
        (of(13, better="higher"), of(6, better="higher"), "worse"),
        (of(13, better="higher"), of(12.9, better="higher"), "changed"),
        (of(0), of(0), "same"),
        (of(0, better="lower"), of(1, better="lower"), "worse"),
        (of(math.nan), of(math.nan), "same"),
        (of(math.nan), of(1), "changed"),
        (of(1, unit="s"), of(1, unit="ms"), "changed"),
        (cost(1, 0.1, "s"), cost(2, 0.1, "s"), "slower"),
        (cost(1, 0.1, "s"), cost(0.5, 0.1, "s"), "faster"),
        (cost(1, 0.1, "s"), cost(1.15, 0.1, "s"), "same"),
        (cost(1, 0.01, "s"), cost(1.09, 0.01, "s"), "same"),
        (cost(100, 1, "MB"), cost(150, 1, "MB"), "worse"),
        (cost(9, 1, "Mpx/s", "higher"), cost(5, 1, "Mpx/s", "higher"), "slower"),
        (cost(1, math.nan, "s"), cost(3, math.nan, "s"), "changed"),
    ],
)
def test_what_counts_as_a_change(old, new, expected):
    assert verdict(old, new) == expected


def test_other_machines_and_other_scenes():
    other = {"machine": {"processor": "q", "cores": 2}}
    time = (cost(1, 0.1, "s"), cost(9, 0.1, "s"))
    ratio = (cost(1, 0.1, ""), cost(9, 0.1, ""))
    assert verdict(*time, **other) == "left out"
    assert verdict(*ratio, **other) == "worse"
    assert verdict(of(1), of(1.05), seeds=2) == "same"
    assert verdict(of(1, 0.1, better="lower"), of(2, 0.1, better="lower"), seeds=2) == "worse"
    found = compare.compare(
        run_of({"a/n": time[0]}), run_of({"a/n": time[1]}, versions={"deglint": "2"}, quick=True, **other)
    )
    said = "\n".join(found.notes)
    for words in ("the machines differ: 1 times", "versions differ: deglint 1 -> 2", "the scenes differ"):
        assert words in said


def test_a_busy_machine_is_said():
    busy = {"machine": {"processor": "p", "cores": 2, "load at the start": 0.1, "load at the end": 7.5}}
    found = compare.compare(run_of({}), run_of({}, **busy))
    assert "new ran on a busy machine (load 7.5): what is said of times may be chance" in found.notes
    assert not any("old ran on a busy" in note for note in found.notes)


def test_new_gone_failed_and_not_run():
    old = run_of({"a/n": of(1), "a/gone": of(1), "b/n": of(1), "c/n": of(1)}, experiments={"a": 1, "b": 1, "c": 1})
    new = run_of({"a/n": of(1), "a/new": of(1)}, experiments={"a": 1, "c": 1})
    new.failed["c"] = "ValueError: no"
    found = compare.compare(old, new)
    assert [(c.name, c.verdict) for c in found.changes] == [("a/gone", "gone"), ("a/new", "new")]
    assert found.failed == ("c",)
    assert found.fails("worse")
    assert "c failed in new: ValueError: no" in found.notes
    assert "only old ran b: not compared" in found.notes


def test_the_largest_comes_first_and_exit_codes_tell(experiments, rxdetect, tmp_path):
    for name, factor in (("old", 1.0), ("same", 1.0), ("bad", 3.0)):
        experiments(thesis=lambda _, f=factor: section("thesis", f))
        rxdetect("bench", f"{name}.html", "--json", f"{name}.json", "-q")
    same = rxdetect("bench", "compare", "old.json", "same.json", "--fail-on", "changed")
    assert same.code == 0
    assert "nothing changed" in same.out
    bad = rxdetect("bench", "compare", "old.json", "bad.json")
    assert bad.code == 0
    assert re.search(r"(?s)worse: 2\n.*  thesis/wind09/joyce/rms +4\.2 [^\n]* x 3\n", bad.out)
    assert "slower: 1\n  thesis/cpu" in bad.out
    assert "better: 1\n  thesis/digits" in bad.out
    assert rxdetect("bench", "compare", "old.json", "bad.json", "--fail-on", "worse").code == 1
    assert rxdetect("bench", "compare", "bad.json", "old.json", "--fail-on", "worse").code == 1  # digits
    data = json.loads(rxdetect("bench", "compare", "old.json", "bad.json", "--json").out)
    assert data["counts"]["worse"] == 2
    assert "--most 0" in rxdetect("bench", "compare", "old.json", "bad.json", "--most", 1).out
    sizes = [c["size"] for c in data["changes"] if c["verdict"] == "worse"]
    assert sizes == sorted(sizes, reverse=True)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{}", "does not hold the numbers of a benchmark"),
        ("[1]", "does not hold"),
        ("{", "is not JSON"),
        ('{"made": {}, "failed": {}, "numbers": {"a": {"value": "x"}}}', "does not hold"),
        ('{"made": 1, "failed": {}, "numbers": {}}', "does not hold"),
    ],
)
def test_files_that_are_no_benchmarks_are_refused(rxdetect, tmp_path, text, said):
    (tmp_path / "x.json").write_text(text)
    ran = rxdetect("bench", "compare", "x.json", "x.json")
    assert ran.code == 1
    assert said in ran.err
    assert len(ran.err.splitlines()) == 1
    assert rxdetect("bench", "compare", "none.json", "x.json").code == 1


def test_help_names_the_experiments_and_the_comparison(rxdetect):
    said = rxdetect("bench", "--help").out
    assert all(name in said for name in (*EXPERIMENTS, "compare OLD.json NEW.json"))
    assert "--fail-on" in rxdetect("bench", "compare", "--help").out
