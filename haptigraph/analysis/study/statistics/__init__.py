"""Statistics of a study report: rank tests, effect sizes, mixed models, sensitivity analysis, SUS."""
