"""From pixels to places in the eye frame: registration, detection, smoothing; the displayed picture."""
