"""The simulated robot and its simulated operator."""
