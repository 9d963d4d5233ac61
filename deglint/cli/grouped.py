"""A command whose `--help` lists its options in groups, with bold headings on a terminal."""

from typing import ClassVar

import click

OPTION_GROUPS = {
    "What to do": (
        "method", "lines", "window", "border", "covariance", "ridge", "drop", "sample", "compensate",
        "smallest_object", "mask", "bands", "background", "pfa", "false_per_km2", "threshold", "largest_object",
        "side", "moving", "min_size", "merge_distance", "model_in",
    ),
    "Details of the fit": ("regression", "tolerance", "floor_percentile", "nir_use", "rrs_factor"),
    "Input": (),
    "Output": (
        "flags", "amount", "stderr", "picture", "p_value", "objects", "save_model", "save_sample", "save_background",
        "dtype", "options", "chips", "directory", "table", "overwrite", "dry_run",
    ),
    "Processing": ("threads", "jobs", "cluster", "workers", "worker_memory"),
    "Messages": ("as_json", "verbose", "quiet", "help"),
}  # fmt: skip
"""Headings, and the names of the options below each; all other options are listed under "Input"."""
SETTINGS = {"help_option_names": ["-h", "--help"], "show_default": True}  # click settings of a grouped command


class _Formatter(click.HelpFormatter):
    def write_heading(self, heading: str) -> None:
        self.write(click.style(f"{'':>{self.current_indent}}{heading}:", bold=True) + "\n")


class BoldContext(click.Context):
    """Context of click whose help has bold headings on a terminal."""

    formatter_class = _Formatter


class Grouped(click.Command):
    """Command that lists its options in groups; a subclass with its own `groups` must list all its options there."""

    context_class = BoldContext
    groups: ClassVar[dict[str, tuple[str, ...]]] = OPTION_GROUPS

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, group by group."""
        heading = {name: group for group, names in self.groups.items() for name in names}
        found: dict[str, list[tuple[str, str]]] = {group: [] for group in self.groups}
        for parameter in self.get_params(ctx):
            if record := isinstance(parameter, click.Option) and parameter.get_help_record(ctx):
                name = "help" if "--help" in parameter.opts else parameter.name or ""
                found[heading.get(name, "Input")].append(record)
        for group, records in found.items():
            if records:
                with formatter.section(group):
                    formatter.write_dl(records)


class Judging(Grouped):
    """Command with the option groups of `rxdetect roc` and `rxdetect bench`."""

    groups: ClassVar[dict[str, tuple[str, ...]]] = {
        "What to do": (
            "per_object", "connected", "mask", "pfa_max", "draws", "block", "seed", "lower", "quick", "only", "seeds",
        ),
        "Output": ("report", "json_file", "overwrite"),
        "Messages": OPTION_GROUPS["Messages"],
    }  # fmt: skip
