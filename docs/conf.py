"""Settings of the site: `nox -s docs` builds it, without a network, and takes warnings as errors."""

import re
import shutil
import sys
import warnings
from importlib import import_module
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

import deglint  # noqa: E402
from deglint import sensors  # noqa: E402

project, author, copyright = "deglint", "The deglint developers", "The deglint developers"  # noqa: A001
version = release = deglint.__version__
extensions = [
    "myst_parser", "numpydoc", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx_click",
    "sphinx_gallery.gen_gallery",
]  # fmt: skip
include_patterns = ["*.md", "reference/**", "tutorials/**"]
html_theme = "pydata_sphinx_theme"
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "footer_start": ["copyright"],
    "secondary_sidebar_items": {"*": ["page-toc"], "reference/**": ["page-toc"], "tutorials/**": []},  # code is wide
}
html_sidebars = {"index": [], "start": []}
html_static_path, html_css_files = ["_static"], ["wide.css"]
html_sourcelink_suffix = ""
myst_enable_extensions = ["colon_fence"]
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
autodoc_typehints = "none"  # the docstrings say them, with units
autosummary_generate = True
suppress_warnings = ["config.cache"]
sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "tutorials",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_memory": False,
    "capture_repr": (),
    "abort_on_example_error": True,
}

warnings.filterwarnings("ignore", message="Scales differ across bands")  # rioxarray; deglint.xr reads them all

PUBLIC = (
    "deglint", "deglint.xr", "deglint.simulate", "deglint.plan", "deglint.plotting", "deglint.cluster",
    "deglint.physics.presets", "deglint.physics.glint", "detect", "detect.xr", "detect.report",
)  # fmt: skip
"""Modules whose public names have a page each; those of `__all__`, else all that they define."""


def names(module):
    """Public names that a module offers."""
    found = getattr(module, "__all__", None) or [
        name for name, value in vars(module).items()
        if not name.startswith("_") and getattr(value, "__module__", "") == module.__name__
    ]  # fmt: skip
    return sorted(name for name in found if not name.startswith("_") and callable(getattr(module, name)))


def write_reference():
    """Write the list of public names, which autosummary makes pages of; pages of names that are gone go."""
    shutil.rmtree(HERE / "reference" / "generated", ignore_errors=True)
    lines = ["Python", "======", "", "Every public class and function.", ""]
    for name in PUBLIC:
        module = import_module(name)
        lines += [name, "-" * len(name), "", (module.__doc__ or "").splitlines()[0], "", ".. autosummary::",
                  "   :toctree: generated", ""]  # fmt: skip
        lines += [f"   {name}.{found}" for found in names(module)] + [""]
    (HERE / "reference" / "python.rst").write_text("\n".join(lines), encoding="utf-8")


SENSORS = """# Sensors

The sensors that `--sensor` knows. When the site is built, this page is written from `deglint/sensors.toml`.
[Name bands and sensors](../bands.md) says how the bands of a file are matched, and how to add a sensor of your own.

- **Centre** and **width** are the centre wavelength and the full width of a band.
- **Time offset** is the time of a band after the first band. `-` means that it is not known.
  The time offsets of Sentinel-2 are those of the odd-numbered detectors. Even-numbered detectors take the bands in the
  reverse order.
- Bands of one **group** are taken at (nearly) the same time.
- *Verified* values were read in the public source that is named. *Unverified* values are commonly quoted, but no source
  was read. *Defined* values belong to a sensor that exists only in simulations.
"""


def write_sensors():
    """Write the page of the known sensors."""
    lines = [SENSORS]
    for sensor in map(sensors.load, sensors.names()):
        times = next((b.time_status for b in sensor.bands if b.time_status), "not known")
        known = [f"centres {sensor.wavelength_status}", f"widths {sensor.width_status}", f"time offsets {times}"]
        known += [f"groups {sensor.group_status}"] if sensor.bands[0].group else []
        other = ", ".join(f"`{name}`" for name in sensor.aliases)
        order = "" if sensor.ordered else " Files come in more than one band order: bands are never matched by number."
        lines += [f"## {sensor.name}", "", f"{sensor.title}. Other names: {other}. Values: {', '.join(known)}.{order}"]
        lines += ["", "| band | centre [nm] | width [nm] | time offset [s] | group |", "|---|---:|---:|---:|---|"]
        for b in sensor.bands:
            time = "-" if b.time_offset is None else f"{b.time_offset:.3f}"
            lines.append(f"| {b.name} | {b.wavelength:g} | {b.width:g} | {time} | {b.group or '-'} |")
        sources = [re.sub(r"https:[^ ;,]+", r"<\g<0>>", source) for source in sensor.sources] or ["No source was read."]
        lines += ["", *(f"- {source}" for source in sources), ""]
    (HERE / "reference" / "sensors.md").write_text("\n".join(lines), encoding="utf-8")


def as_literal(_app, _context, lines):
    """Show the examples of a command as code, not as lines of text."""
    out, inside = [], False
    for line in lines:
        if line.startswith("| "):
            out += [] if inside else ["", "::", ""]
            out.append(f"   {line[2:]}")
        else:
            out += ["", line] if inside else [line]
        inside = line.startswith("| ")
    lines[:] = out


def setup(app):
    """Connect what is above."""
    app.connect("sphinx-click-process-description", as_literal)


write_reference()
write_sensors()
