"""The command `rxdetect score`: compute a raster of anomaly scores, a threshold, and the objects above it."""

import json
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import click

from deglint.cli import options
from deglint.cli.running import Console

SHARE = click.FloatRange(0, 1, min_open=True, max_open=True)
SHARE.name = "share between 0 and 1, such as 1e-4"  # in the message: "5%" is not a valid ...


def pair(kind: Callable[[str], float], name: str, example: str) -> Callable[..., object]:
    """Make a click callback that parses "A,B", two numbers of type `kind`; errors show `name` and `example`."""

    def read(text: str) -> tuple[float, float]:
        first, second = map(kind, text.split(","))
        return first, second

    return options.parsed(read, f"is not {name}, such as {example}.")


# fmt: off
@click.command(cls=options.Grouped, context_settings=options.SETTINGS)
@click.argument("inputs", nargs=-1, type=options.FILE, metavar="IN [IN ...]")
@click.argument("output", type=options.FILE, metavar="OUT")
@options.heading("What to do")
@click.option("--method", type=options.ChoiceFromTable("DETECTORS", "detect.global_rx", "auto"), default="auto",
              help="Detector (see Methods); auto: sea where there is water, else rx.")
@click.option("--lines", is_flag=True, help="The same as --method lines: in the order of the file, in bounded memory.")
@click.option("--window", default="5,21", callback=pair(int, "INNER,OUTER", "5,21"), metavar="INNER,OUTER",
              help="For local: sides of the guard and of the window around it, odd, in pixels. The guard should hold "
              "the largest object.")
@click.option("--border", type=options.ChoiceFromTable("BORDERS", "detect.local"), default="shrink",
              help="For local, at the scene's edge: the window loses what is outside, mirrors the scene, or moves "
              "inside.")
@click.option("--covariance", type=options.ChoiceFromTable("COVARIANCES", "detect.background"), default="empirical",
              help="How the covariance is estimated; mcd is robust, from the core of the background alone. local: "
              "empirical or ridge.")
@click.option("--ridge", type=click.FloatRange(0), default=1e-3, metavar="SHARE",
              help="For --covariance ridge: add this share of each band's variance.")
@click.option("--drop", type=click.IntRange(0), default=1, metavar="N",
              help="For subspace: leading eigenvectors to leave out.")
@click.option("--background", type=options.FILE, default="", metavar="FILE|WINDOW", show_default="every valid pixel",
              help="What pixels are compared with: polygons (GeoJSON), a mask raster (not 0), a window "
              "column,row,width,height, or a saved background.")
@options.bands_to("-b", "--band", "bands", shown="the visible ones for sea, else all",
                  said="Bands to use, by name or number (from 1).")
@options.place("--mask", "auto|none|water|FILE|WINDOW",
               "Where to score: everywhere, on water as found in the scene, or in a raster (not 0) or GeoJSON. "
               "What lies outside is in no background either; for sea the holes of ships are filled. auto: water for "
               "sea, else everywhere.")
@click.option("--pfa", type=SHARE, metavar="RATE",
              help="Accepted false alarms per pixel, such as 1e-4; sets the threshold.")
@click.option("--threshold", type=options.ChoiceFromTable("THRESHOLDS", "detect.threshold"), default="gpd",
              help="Threshold from a generalised Pareto distribution fitted to the highest scores (gpd), from their "
              "quantile (empirical), or for a normal background (f, chi2), which real scenes seldom follow.")
@click.option("--false-per-km2", type=click.FloatRange(0, min_open=True), metavar="RATE",
              help="For sea, in place of --pfa: accepted false objects per square kilometre of sea, such as 0.1.")
@click.option("--largest-object", default="400,60", callback=pair(float, "LENGTH,WIDTH", "400,60"),
              metavar="LENGTH,WIDTH", help="For sea: length and width of the largest ship, in metres: "
              "holes in the water mask up to this size are searched, too; 0,0: none.")
@click.option("--side", type=options.ChoiceFromTable("SIDES", "detect.sea.model", "auto"), default="auto",
              help="For sea: search what is brighter than the water around, or also what is darker. auto: bright from "
              "pixels of 5 m on, else both.")
@click.option("--moving", is_flag=True,
              help="Give objects a speed and a heading; needs three bands or more at known, different times.")
@click.option("--min-size", type=click.IntRange(1), default=1, metavar="PIXELS", help="Drop smaller objects.")
@click.option("--merge-distance", type=click.FloatRange(0), default=0.0, metavar="PIXELS",
              help="Merge parts up to this distance apart into one object.")
@options.reading
@options.heading("Output")
@click.option("--save-background", type=options.FILE, metavar="FILE.json",
              help="Write the fitted background, to use on another scene.")
@click.option("--objects", type=options.FILE, metavar="FILE.geojson|.gpkg",
              help="Write outlines, positions (WGS 84), sizes and scores of what exceeds the threshold; a .gpkg gets a "
              "QGIS style.")
@click.option("--chips", type=options.FILE, metavar="FOLDER",
              help="Write a picture of every object: raw, clean, score.")
@click.option("--p-value", type=options.FILE, metavar="FILE",
              help="Write the p-value of every score, for a normal background.")
@click.option("--flags", type=options.FILE, metavar="FILE",
              help="Write why a pixel has no score, and other notes: 1 nodata, 2 outside --mask, 4 outside "
              "--background, 8 ring of lower rank, 16 ring of too few pixels, 32 water beside land, 64 no water, but "
              "may float, 128 ship or short pier at a quay.")
@options.creation
@click.option("--overwrite", is_flag=True, help="Replace outputs that exist.")
@options.processing
@options.print_sidecar
@options.messages
def score(inputs: tuple[str, ...], output: str, **given: Any) -> None:
    """Score how anomalous every pixel of IN is, and write OUT, a GeoTIFF of one float32 band.

    Scores of --method sea are distances from the water around a pixel, in standard deviations. Most other scores are
    squared Mahalanobis distances: at background pixels, about the number of bands. Pixels without a score are NaN.
    OUT.json beside OUT says what was done. --objects writes objects above the threshold of --pfa or --false-per-km2.

    \b
    rxdetect score clean.tif scores.tif
    rxdetect score clean.tif scores.tif --pfa 1e-4 --objects found.geojson
    rxdetect score clean.tif scores.tif --false-per-km2 0.1 --objects found.gpkg --chips chips
    rxdetect score scene.tif scores.tif --method local --window 5,21 --mask water
    rxdetect score scene.tif scores.tif --background sea.geojson --save-background sea.json
    rxdetect score other.tif scores2.tif --background sea.json
    rxdetect score strip.tif scores.tif --lines --pfa 1e-4 --objects found.geojson
    """
    options.needs_output(inputs, output, "rxdetect score")
    if given.pop("lines"):
        if given["method"] not in ("auto", "lines"):
            raise click.UsageError(f"--lines is a method of its own: leave out --method {given['method']}.")
        given["method"] = "lines"
    with Console(given) as console, options.cluster_of(given) as cluster:
        from ..pipeline import Recipe, score_file

        recipe = Recipe(**{f.name: given[f.name] for f in fields(Recipe) if f.name in given})
        same = {name: given[name] for name in ("p_value", "flags", "objects", "chips", "overwrite", "options")}
        result = score_file(list(inputs), output, recipe, **options.opening(given), **same, threads=given["threads"],
                            cluster=cluster, background=given["save_background"], progress=console.progress)
    if given["as_json"]:
        click.echo(json.dumps(result.sidecar, indent=2))
# fmt: on
