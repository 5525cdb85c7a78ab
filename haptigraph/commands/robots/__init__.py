"""Commands that place a robot in space and time."""
