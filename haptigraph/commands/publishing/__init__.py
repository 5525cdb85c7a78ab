"""Commands that publish a study: study export, study video."""
