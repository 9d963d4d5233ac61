"""Tasks of a developer: `nox -l` lists them, `nox -s docs` runs one."""

import nox

nox.options.sessions = ["tests", "lint", "types"]
nox.options.default_venv_backend = "uv|venv"


@nox.session(python=["3.11", "3.12", "3.13", "3.14"])
def tests(session: nox.Session) -> None:
    """Run the tests; arguments after -- go to pytest."""
    session.install(".[test]")
    session.run("pytest", "-q", "-n", "auto", "--dist", "loadfile", *session.posargs)


@nox.session
def lint(session: nox.Session) -> None:
    """Check style and the direction of imports."""
    session.install("-e", ".[dev]")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("lint-imports")


@nox.session
def types(session: nox.Session) -> None:
    """Check types."""
    session.install("-e", ".[dev]")
    session.run("mypy")


@nox.session
def docs(session: nox.Session) -> None:
    """Build the site into docs/_build; warnings are errors."""
    session.install(".[docs,xarray,cluster]")
    session.run("sphinx-build", "-W", "--keep-going", "-b", "html", "docs", "docs/_build/html", *session.posargs)


@nox.session
def benchmarks(session: nox.Session) -> None:
    """Run benchmarks; arguments after -- go to `python -m benchmarks`."""
    session.install(".[test]")
    session.run("python", "-m", "benchmarks", *(session.posargs or ["size"]))


@nox.session
def build(session: nox.Session) -> None:
    """Build the wheel, the source archive and the QGIS plugin into dist/."""
    session.install("build")
    session.run("python", "-m", "build")
    session.run("python", "qgis/make_zip.py", "dist")
