"""Physics of the sea surface, the water and the sensor: pure functions on plain arrays.

Conventions, in every module of this package:

- angles are in degrees, wavelengths in nanometres, lengths in metres, times in seconds, speeds in m/s,
  pressure in hPa, water vapour in cm, ozone in Dobson units; radians never cross a function boundary;
- azimuth is clockwise from north; the wind direction is where the wind blows *from*; positions of the sun and
  of the sensor are given as seen from the target (zenith angle, azimuth);
- slopes are dz/dx without unit; "upwind" is the axis towards where the wind comes from, "crosswind" is 90
  degrees clockwise of it;
- arguments broadcast like numpy arrays (give ``wavelength[:, None, None]`` to get one layer per band); NaN in gives
  NaN out; a value out of its range, a model that does not exist and a time that cannot be read raise `InputError`;
- nothing is read from disk but the tables of this package, when they are first needed, and nothing is logged.

The modules and their functions document themselves; `deglint.physics.presets` has sensors by name.
"""
