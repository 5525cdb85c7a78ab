"""The study's pages: one for the experimenter, one for the participant."""
