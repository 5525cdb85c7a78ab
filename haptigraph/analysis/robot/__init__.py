"""Where a robot is, and whether its clock agrees with the images: from recorded runs."""
