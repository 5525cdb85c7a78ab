"""The preregistered analysis: its hypotheses, families of tests, and what is left out."""
