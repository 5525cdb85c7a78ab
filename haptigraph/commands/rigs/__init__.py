"""Commands of rigs: whether one is set up as a run relies on."""
