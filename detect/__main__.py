"""Entry point of `python -m detect`, which runs the command `rxdetect`."""

from .cli import main

main()
