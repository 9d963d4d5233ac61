"""QGIS plugin: the commands `deglint` and `rxdetect` as algorithms of the Processing toolbox."""


def classFactory(_iface):  # noqa: N802  (QGIS asks for this name)
    """Make the plugin."""
    from .plugin import Plugin

    return Plugin()
