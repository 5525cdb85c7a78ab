"""Analysis: registrations, scores against ground truth, measures and figures of recordings."""
