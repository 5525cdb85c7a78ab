"""The C core. Every function has one wrapper, which checks its arguments before C reads or writes them.

A wrapper raises TypeError for an argument of another type, and ValueError for an array of another shape or
type, a number that is out of range, or a part that is not within its strip.
"""
