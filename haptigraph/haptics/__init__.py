"""Haptic output: patterns, renderer, the guard that can always silence the actuator, and devices."""
