"""One word for each meaning: words that the glossary replaces occur nowhere, and a constant has one value."""

import ast
import re
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("deglint", "detect", "benchmarks")
TYPE = re.compile(r"(?:[A-Z][a-z0-9]+)+")  # name of a class or of an alias of a type
SOURCES = {path: path.read_text(encoding="utf-8") for room in PACKAGES for path in sorted((ROOT / room).rglob("*.py"))}
PAGES = {
    path: path.read_text(encoding="utf-8")
    for room, kind in (("tests", "**/*.py"), ("benchmarks", "*.py"), ("docs", "*.md"), (".", "*.md"))
    for path in sorted((ROOT / room).glob(kind))
    if path != Path(__file__)
}
PHRASES = {
    r"things?": "target, or what it is",
    r"(?:bands of|at) different instants": "bands that are not simultaneous",
    r"asked for by name": "selected explicitly",
    r"pass(?:ed|es)? unchanged": "copied",
    r"left as (?:they are|it is)": "copied, not corrected",
    r"(?:told|tells?|telling) (?:\w+ ){,2}(?:by|from|apart)|be told": "determined from, distinguished",
    r"(?:put|puts|given|gives?) back": "restored, returned",
    r"(?:stands?|stood|standing) out": "exceeds the background by k standard deviations",
    r"(?:whole|full) numbers?": "integers, saturated values",
    r"(?:does|do) not belong": "anomaly",
    r"(?:keep|keeps|kept) out": "excluded",
    r"Pfa (?:designed|allowed|achieved)": "requested, observed false-alarm rate",
}
"""What is not written, and what is written instead."""
NAMES = {
    "Look", "Shown", "Begun", "Tally", "Witness", "Opened", "Spread", "Weighed", "Nothing", "settle", "hand_over",
    "agree", "rigid", "plainly", "lifted", "glance", "evidence", "lasting", "presence", "codes", "thing", "things",
    "look", "calm", "surroundings", "warming", "tally", "faint",
}  # fmt: skip
"""Names of modules, classes, functions, fields and arguments that say too little."""
PROTOCOL = {"IMAGES", "METADATA", "HOMES"}
"""Constants that are looked up by name: of each product, and of the lazy loading of each package."""


@pytest.mark.parametrize("phrase", PHRASES)
def test_the_terms_of_the_glossary_are_used(phrase):
    banned = re.compile(rf"\b(?:{phrase})\b".replace(" ", r"\s+(?:# )?"))
    found = [
        f"{path.relative_to(ROOT)}:{text[: hit.start()].count(chr(10)) + 1}: {hit[0]}"
        for path, text in (SOURCES | PAGES).items()
        for hit in banned.finditer(text.replace("_", " "))
    ]
    assert not found, f"write: {PHRASES[phrase]}"


def named(tree):
    """Every class, function, argument and field of a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            yield node.target.id


def test_names_say_what_they_name():
    found = {
        f"{path.relative_to(ROOT)}: {name}"
        for path, text in SOURCES.items()
        for name in (path.stem, *named(ast.parse(text)))
        if name.strip("_") in NAMES
    }
    assert not found


def constants(tree):
    """Names in capitals that a module gives a value, and the value's text."""
    for node in tree.body:
        if (value := getattr(node, "value", None)) is None:
            continue
        for target in getattr(node, "targets", [getattr(node, "target", None)]):
            pairs = [(target, ast.unparse(value))]
            if isinstance(target, ast.Tuple):
                values = [ast.unparse(each) for each in getattr(value, "elts", ())]
                values = values or [f"{ast.unparse(value)}[{i}]" for i in range(len(target.elts))]
                pairs = zip(target.elts, values, strict=True)
            for name, own in pairs:
                if isinstance(name, ast.Name) and name.id.strip("_").isupper():
                    yield name.id.lstrip("_"), own


@pytest.mark.parametrize("package", PACKAGES)
def test_a_class_or_type_has_one_definition_in_its_package(package):
    found = defaultdict(set)
    for path, text in SOURCES.items():
        for node in ast.parse(text).body if path.is_relative_to(ROOT / package) else ():
            if isinstance(node, ast.ClassDef):
                found[node.name].add(str(path.relative_to(ROOT)))
            elif isinstance(node, ast.Assign) and TYPE.fullmatch(name := ast.unparse(node.targets[0])):
                found[name].add(ast.unparse(node.value))  # aliases of one type may be repeated
    assert {name: places for name, places in found.items() if len(places) > 1} == {}


@pytest.mark.parametrize("package", PACKAGES)
def test_a_constant_has_one_value_in_its_package(package):
    values = defaultdict(lambda: defaultdict(list))
    for path, text in SOURCES.items():
        if path.is_relative_to(ROOT / package):
            for name, value in constants(ast.parse(text)):
                values[name][value].append(str(path.relative_to(ROOT)))
    assert {n: dict(v) for n, v in values.items() if len(v) > 1 and n not in PROTOCOL} == {}
