"""Physics of the sea surface, the water and the sensor: pure functions on plain arrays.

Conventions, in every module of this package:

- angles that functions take and return are in degrees, wavelengths in nanometres, lengths in metres (visibility in
  kilometres), times in seconds, speeds in m/s, pressure in hPa, water vapour in cm, ozone in Dobson units;
- azimuth is clockwise from north; the wind direction is where the wind blows *from*; the directions of the sun
  and of the sensor are given as seen from the target (zenith angle, azimuth);
- slopes are dz/dx without unit; the "upwind" axis points to where the wind comes from, and the "crosswind" axis
  points 90 degrees clockwise of it;
- arguments broadcast like numpy arrays (``wavelength[:, None, None]`` and angles (row, column) give one image for each
  wavelength); where an input array is NaN, a floating-point result is NaN; `InputError` is raised for a value outside
  its range, an unknown model or an unreadable time; the only files read are the package's tables; nothing is logged.

`deglint.physics.presets` defines a number of sensors.
"""

EARTH_RADIUS = 6_371_000.0  # mean radius of the Earth [m]
