"""OCT volumes of a retina and a needle, with their ground truth in three dimensions."""
