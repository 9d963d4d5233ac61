"""The command `deglint`: one module for each subcommand, imported when it is called."""

import os
import sys
from typing import NoReturn

import click

from .. import __version__
from . import running

COMMANDS = {
    "remove": "remove glint from a raster",
    "batch": "remove glint from many rasters; can be interrupted and continued",
    "info": "describe a raster, and suggest a method to remove glint",
    "plan": "plan viewing geometries that avoid glint",
    "simulate": "simulate an image of the sea, with ground truth",
}


@click.group("deglint", cls=running.Commands, home=__name__, lines=COMMANDS)
@click.version_option(__version__, "--version", prog_name="deglint")
def cli() -> None:
    """Find and remove sun glint in multispectral images of the sea.

    \b
    deglint remove scene.tif clean.tif --picture look.png
    deglint info scene.tif
    """


def main() -> NoReturn:
    """Run the command and exit with its code: 0 done, 1 failed, 2 wrong usage, 3 no usable water, 130 interrupted."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # arrays are small here, and its threads wait in busy loops
    sys.exit(run(sys.argv[1:]))


run = cli.run  # function that runs the command with its arguments, and returns its exit code
