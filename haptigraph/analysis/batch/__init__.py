"""Batches: replay, measure, evaluate or export all recordings below a folder, and report on them together."""
