"""What a study fixes before its data: the analysis, and the texts of the protocol that are frozen."""
