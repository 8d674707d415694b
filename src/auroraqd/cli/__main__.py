"""`python -m auroraqd.cli`."""

from auroraqd.cli import main

main()
