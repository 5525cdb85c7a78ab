"""From pixels to positions in the eye frame: needle, anatomy, OCT, forceps; and the displayed view."""
