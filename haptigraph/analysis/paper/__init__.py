"""The figures of the paper, of any recorded run."""
