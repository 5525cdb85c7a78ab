"""The compiled part of perception, in C, and one checked wrapper per function: no argument can crash it."""
