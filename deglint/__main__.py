"""`python -m deglint` is the command `deglint`."""

from .cli import main

main()
