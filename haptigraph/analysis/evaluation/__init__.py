"""Score perception and surgical states against ground truth: labelled clips and simulated scenes."""
