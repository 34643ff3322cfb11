"""`python -m tuning`: the command line."""

from tuning.cli import main

main()
