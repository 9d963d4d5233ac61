"""docs/products.md holds a table of what these tests open: how, what was known, and what had to be assumed.

`pytest tests/products/test_table.py --write-docs` writes the table anew.
"""

import re
from pathlib import Path

import deglint

PAGE = Path(__file__).parents[2] / "docs" / "products.md"
BEGIN, END = "<!-- table: written by tests/products/test_table.py -->\n", "<!-- end of the table -->"


def row(path, folder):
    """What a line of the table says of one product: the kind, how it was opened, what is known, and the rest."""
    scene = deglint.open_scene(path)
    info, bands = scene.source.info, scene.bands
    kind = re.match(r"(.*?), product ", scene.notes[0])[1]
    name = path.name if len(path.name) <= 24 else f"{path.name[:10]}...{path.name[-12:]}"
    how = "the files in a folder" if path == folder else f"{'folder' if path.is_dir() else 'file'} `{name}`"
    known = [
        f"{len(bands)} bands: names, wavelengths, widths" if all(b.width for b in bands) else f"{len(bands)} bands"
    ]
    scale, offset = (f"{v[0]:.4g}" + (" ..." if len(set(v)) > 1 else "") for v in (info.scales, info.offsets))
    known.append(f"scale {scale}, offset {offset}" + (f" ({info.units[0]})" if info.units[0] else ""))
    if info.nodatas[0] is not None:
        known.append(f"nodata {info.nodatas[0]:g}")
    if any("FULL_SCALE" in tags.get("", {}) for tags in info.band_tags):
        known.append("saturation")
    known += [f"sensor {scene.sensor}"] if scene.sensor else []
    known += ["time offsets"] if any(b.time_offset is not None for b in bands) else []
    known += ["detector footprints"] if scene.footprints is not None else []
    rest = [n.replace(f"{folder}/", "") for n in scene.notes[1:] if not n.startswith("sensor ")]
    return kind, how, "; ".join(known), "<br>".join(rest) or "nothing"


def test_the_table_in_the_docs_is_what_comes_of_opening(cases, sea, tmp_path, request):
    lines = ["| product | opened by | known from its metadata | assumed, left out or not done |", "|---|---|---|---|"]
    ways = {}
    for i, (module, maker, _kind, _facts) in enumerate(cases.values()):
        folder = tmp_path / str(i)
        folder.mkdir()
        kind, how, *said = row(Path(maker(module, folder, sea())), folder)
        ways.setdefault((kind, *said), []).append(how)
    for (kind, *said), how in ways.items():
        lines.append(f"| {' | '.join((kind, '<br>'.join(dict.fromkeys(how)), *said))} |")
    made = "\n".join(lines) + "\n"
    text = PAGE.read_text()
    before, _, rest = text.partition(BEGIN)
    held, end, after = rest.partition(END)
    assert end, f"{PAGE} has no place for the table"
    if request.config.getoption("--write-docs"):
        PAGE.write_text(before + BEGIN + made + END + after)
        held = made
    assert held == made, "docs/products.md is not what the tests find: run this test with --write-docs"
