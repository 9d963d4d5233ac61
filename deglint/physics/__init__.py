"""Physics of the sea surface, the water and the sensor: pure functions on plain arrays.

Conventions, in every module of this package:

- angles are in degrees, wavelengths in nanometres, lengths in metres, times in seconds, speeds in m/s,
  pressure in hPa, water vapour in cm, ozone in Dobson units; radians never cross a function boundary;
- azimuth is clockwise from north; the wind direction is where the wind blows *from*; positions of the sun and
  of the sensor are given as seen from the target (zenith angle, azimuth);
- slopes are dz/dx without unit; the "upwind" axis points to where the wind comes from, and the "crosswind" axis
  points 90 degrees clockwise of it;
- arguments broadcast like numpy arrays (give ``wavelength[:, None, None]`` to get one layer per band); where an input
  is NaN, the result is NaN; a value out of its range, an unknown model and an unreadable time raise `InputError`;
- the only files that are read are the tables of this package, at first use; nothing is logged.

Each module documents its own functions; `deglint.physics.presets` has sensors by name.
"""
