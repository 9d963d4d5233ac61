"""Measurements for developers: `python -m benchmarks NAME`; `--help` lists the names."""
