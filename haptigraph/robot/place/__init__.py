"""Where a robot is: transforms and pivots from points and motion."""
