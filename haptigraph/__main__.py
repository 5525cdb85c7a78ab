"""Let `python -m haptigraph` be the command line."""

from haptigraph.cli import main

main()
