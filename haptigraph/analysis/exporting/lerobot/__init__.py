"""Export recorded runs as a dataset for LeRobot, format v3.0, without LeRobot's library."""
