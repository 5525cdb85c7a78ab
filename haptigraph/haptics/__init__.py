"""From states to touch: patterns, renderer, the guard that can always still the hand, and devices."""
