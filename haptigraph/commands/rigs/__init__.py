"""Commands for a rig: its camera and its check."""
