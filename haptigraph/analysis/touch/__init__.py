"""Haptic patterns and files: load, convert, draw and play them."""
