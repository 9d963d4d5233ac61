"""The benchmark of all glint removals, `rxdetect bench`: `scenes` simulates, `run` measures, `report` makes a page."""
