"""A study's statistics: rank tests, effect sizes, mixed models, sensitivity, SUS."""
