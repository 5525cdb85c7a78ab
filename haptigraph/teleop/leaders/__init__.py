"""Leaders: what a hand moves, so that a robot, simulated or real, follows."""
