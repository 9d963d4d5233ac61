"""Measurements that anyone can make again: `python -m benchmarks`, or `rxdetect bench`; `--help` lists them."""
