"""Check a rig from a few seconds of its images: one module a subject, together in `judging`."""
