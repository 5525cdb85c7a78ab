"""Force feedback: fixtures in the eye, their rendering at 1 kHz within limits, and devices with force."""
