"""Make `python -m haptigraph` the command line."""

from haptigraph.cli import main

if __name__ == "__main__":  # child processes import this module, too
    main()
