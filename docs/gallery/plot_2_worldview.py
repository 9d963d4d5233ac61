"""
WorldView: bands that are not simultaneous
==========================================

WorldView-3 takes its bands in two sets, 0.3 s apart. Waves move in between, so glint of the NIR and glint of a visible
band lie at different places. The times are known for the sensor, and the default method makes use of them.
"""

from pictures import show

import deglint

# %%
# A sample scene of the repository: 256 x 256 pixels of 1.24 m, wind 8 m/s, boats, a reef, and objects under water.
scene = deglint.open_scene("../../sample_data/sea_1m.tif")
for band in scene.bands:
    print(f"{band.name:8s} {band.wavelength:6.1f} nm  seen at {band.time_offset:.3f} s")

# %%
# A method of one slope a band, as published in 2005, and the default.
hedley = deglint.Recipe(method="hedley", compensate="off")
results = {"Hedley (2005)": hedley, "default": deglint.Recipe()}
clean = {n: deglint.correct(scene, deglint.fit_scene(scene, recipe)) for n, recipe in results.items()}

# %%
# The truth is the radiance without glint and noise, through the same optics. Hedley's method darkens the boats, since
# they are bright in the NIR; this makes up most of its error. The default finds targets first, and restores them.
truth = deglint.open_scene("../../sample_data/sea_1m_truth.tif").read()
figure = show({"raw": scene.read(), "truth": truth, **clean}, truth, bands=(4, 2, 1))
