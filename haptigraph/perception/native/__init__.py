"""The compiled part of perception, in C: what would take NumPy hundreds of small calls per image."""
