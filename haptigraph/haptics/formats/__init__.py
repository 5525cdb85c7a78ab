"""Files of haptic designers: one module a format, and the form in memory that all share."""
