"""The benchmark `rxdetect bench` of all removal methods: `scenes` simulates, `run` measures, `report` writes a page."""
