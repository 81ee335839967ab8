"""`python -m estim` is `estim`."""

from estim.cli import main

main()
