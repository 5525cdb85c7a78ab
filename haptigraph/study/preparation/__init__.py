"""What precedes the trials of a study: the calibration of the hand, and training. Pure."""
