"""Commands of a study beside study itself: run, report, erase, simulate."""
