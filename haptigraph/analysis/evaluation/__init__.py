"""Score perception and surgical states against ground truth, on labelled clips and simulated scenes."""
