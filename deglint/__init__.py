"""deglint: find and remove sun glint in multispectral images of the sea."""

__version__ = "0.1.0"
