"""Physics of the sea surface, the water and the sensor: pure functions on plain arrays.

Conventions, in every module of this package:

- angles are in degrees, wavelengths in nanometres, lengths in metres, times in seconds, speeds in m/s,
  pressure in hPa, water vapour in cm, ozone in Dobson units; radians never cross a function boundary;
- azimuth is clockwise from north; the wind direction is where the wind blows *from*; positions of the sun and
  of the sensor are given as seen from the target (zenith angle, azimuth);
- slopes are dz/dx without unit; "upwind" is the axis towards where the wind comes from, "crosswind" is 90
  degrees clockwise of it;
- arguments broadcast like numpy arrays (give ``wavelength[:, None, None]`` to get one layer per band); NaN in gives
  NaN out; a value out of its range raises `InputError` with one line;
- nothing is read from disk but the tables of this package, when they are first needed, and nothing is logged.

Modules and their main functions::

    fresnel.reflectance(angle, index=1.34)                     unpolarised, air to water
    fresnel.refraction_angle(angle, index=1.34)                Snell, angle in water
    slopes.density(upwind, crosswind, wind, *, model="cox-munk")
    slopes.gaussian(upwind, crosswind, variance_upwind, variance_crosswind)
    slopes.variances(wind, *, model="cox-munk")                -> (upwind, crosswind)
    slopes.to_wind_axes(east, north, wind_from)                -> (upwind, crosswind)
    slopes.from_wind_axes(upwind, crosswind, wind_from)        -> (east, north)
    slopes.wind_at_height(wind, *, measured_at=10.0, wanted_at=12.5)
    glint.facet(sun_zenith, sun_azimuth, view_zenith, view_azimuth)  -> Facet(east, north, incidence, tilt)
    glint.probability(density, view_zenith, tilt, solid_angle)       fraction of the pixel that glints
    glint.sun_glint(sun_zenith, sun_azimuth, view_zenith, view_azimuth, *, wind, wind_from)
                                                               -> Glint(radiance, probability, density, ...)
    glint.radiance(density, view_zenith, tilt, incidence, *, index)  per unit of normal irradiance [1/sr]
    sky.radiance(zenith, azimuth, sun_zenith, sun_azimuth, *, diffuse=1.0, model="uniform")
    sky.reflectance(view_zenith, view_azimuth, sun_zenith, sun_azimuth, *, wind, wind_from, model="uniform")
                                                               mirrored by the windy sea, per unit of diffuse
                                                               [1/sr]
    atmosphere.irradiance(wavelength, sun_zenith, air=None, *, day=None, **params)
                                                               -> Irradiance(direct, diffuse)
    atmosphere.ozone(latitude, longitude, day)                 climatology [DU]
    sun.position(latitude, longitude, time)                    -> Position(zenith, azimuth)
    sun.next_rise(latitude, longitude, time)                   -> numpy.datetime64
    sun.distance_factor(day), sun.solid_angle(day=None)
    water.case1(wavelength, chlorophyll)                       -> Iops
    water.remote_sensing_reflectance(wavelength, chlorophyll, sun_zenith, view_zenith, relative_azimuth)
    water.object_reflectance(wavelength, chlorophyll, sun_zenith, view_zenith, relative_azimuth,
                             *, depth, reflectance)
"""
