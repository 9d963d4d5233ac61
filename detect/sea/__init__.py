"""Detection of ships, boats and swimmers on the sea: search region, detector and false-alarm rates.

`region` separates water, floating objects and land. `model` compares every pixel of the sea with the water around it.
`search` has thresholds, and the expected number of false objects per km2. No file is opened here.
"""
