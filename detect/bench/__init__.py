"""The benchmark of `rxdetect bench`: run time, error and objects found of every removal method, on simulated scenes.

`scenes` simulates, `run` measures and `report` writes the page.
"""
