"""Settings of the site: `nox -s docs` builds it, without a network, and takes warnings as errors."""

import shutil
import sys
import warnings
from importlib import import_module
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE / "helpers")]

import deglint  # noqa: E402

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

PUBLIC = ("deglint", "deglint.xr", "deglint.simulate", "deglint.plan", "detect", "detect.xr", "detect.report")
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
