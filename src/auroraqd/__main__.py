"""`python -m auroraqd`, where the command `auroraqd` is not on the path."""

from auroraqd.cli import main

main()
