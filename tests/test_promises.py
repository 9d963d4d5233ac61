"""The page of promises is what the tests say."""

import re
from types import SimpleNamespace

from . import promises
from .common import ROOT
from .promises import PAGE, PROMISES, Counts, page


def test_every_test_that_is_named_is_there():
    for rows in PROMISES.values():
        for row in rows:
            text = (ROOT / "tests" / f"{row['file']}.py").read_text()
            assert all(f"def {test}(" in text for test in row["tests"]), row


def test_the_page_is_of_these_promises_and_all_held():
    text = PAGE.read_text()
    assert re.findall(r"^## (.*)$", text, re.MULTILINE) == [*PROMISES, "What is not promised"]
    rows = re.findall(r"^\| (.*) \| (\d+) \| (\w+) \| `tests/(\w+).py` \|$", text, re.MULTILINE)
    asked = [(row["tried"], row["file"]) for own in PROMISES.values() for row in own]
    assert [(what, file) for what, _n, _h, file in rows] == asked
    assert all(int(times) > 0 and held == "all" for _w, times, held, _f in rows)


def test_counts(monkeypatch):
    counts = Counts()
    for node, passed, more in (("a[1]", True, ()), ("a[2]", False, ()), ("b", True, (("tried", 40),))):
        of = {"passed": passed, "failed": not passed, "user_properties": more}
        counts.pytest_runtest_logreport(SimpleNamespace(nodeid=f"tests/x.py::{node}", when="call", **of))
    rows = [{"tried": "it", "file": "x", "tests": ["a"]}, {"tried": "more", "file": "x", "tests": ["b"]}]
    monkeypatch.setattr(promises, "PROMISES", {"p": rows})
    assert "| it | 2 | 1 | `tests/x.py` |" in page(counts)
    assert "| more | 40 | all | `tests/x.py` |" in page(counts)
