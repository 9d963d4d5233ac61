"""Measurements that anyone can make again: `python -m benchmarks speed|error|digits|targets` (add --quick)."""
