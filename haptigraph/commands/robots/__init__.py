"""Commands of robots: check, calibrate, steer."""
