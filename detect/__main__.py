"""`python -m detect` is the command `rxdetect`."""

from .cli import main

main()
