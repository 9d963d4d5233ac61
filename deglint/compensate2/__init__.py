"""Glint compensation: what a linear removal cannot do."""
