"""Studies as files: tidy tables with a data dictionary, and back."""
