"""Let `python -m haptigraph` be the command line."""

from haptigraph.cli import main

if __name__ == "__main__":  # not in the processes that the program starts itself
    main()
