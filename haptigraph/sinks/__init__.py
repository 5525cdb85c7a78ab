"""Where steps go: recorder and console."""
