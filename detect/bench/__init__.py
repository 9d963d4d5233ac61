"""The benchmark: run time against error, ROC against synthetic truth, skipping, and numerical stress.

Every experiment is a module with `run(effort) -> Section`; the table of them, the report and the comparison of two runs
stand beside them.
"""
