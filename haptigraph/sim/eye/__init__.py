"""The simulated eye as a camera sees it."""
