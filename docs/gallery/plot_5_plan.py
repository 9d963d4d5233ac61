"""
Plan a flight
=============

Where should the camera look from, so that glint does not happen? ``reticle`` works it out for all directions.
"""

import matplotlib.pyplot as plt
import numpy as np

from deglint.plan import Mission, reticle

# %%
# Monterey Bay at 11 in the morning of midsummer, with 7 m/s of wind from the north-west.
mission = Mission(latitude=36.8, longitude=-122.0, time="2026-06-21T18:00Z", wind=7.0, wind_from=310.0)
plan = reticle(mission)

# %%
# The contrast of an object at 5 m depth, in units of its noise; white where glint, sky or noise hide it. The angle is
# the azimuth where the camera stands, seen from the object. The radius is its angle off nadir.
azimuth, zenith = np.radians(plan.azimuth), plan.zenith
figure, axis = plt.subplots(subplot_kw={"projection": "polar"}, figsize=(6, 5), layout="constrained")
axis.set(theta_zero_location="N", theta_direction=-1, rmax=70)
mesh = axis.pcolormesh(azimuth, zenith, np.where(plan.combined > 0, plan.combined, np.nan), shading="nearest")
figure.colorbar(mesh, label="contrast / noise")

# %%
# The best direction.
row, column = np.unravel_index(np.nanargmax(plan.combined), plan.combined.shape)
print(f"from azimuth {plan.azimuth[column]:.0f}, {plan.zenith[row]:.0f} degrees off nadir")
plt.show()
