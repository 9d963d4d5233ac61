"""Measurements that anyone can make again: `python -m benchmarks speed`, `error` and `digits` (add --quick)."""
