"""An archive: an index of all recordings below a folder, and queries over it and over all steps."""
