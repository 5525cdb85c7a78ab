"""Export recorded runs to other programs' formats."""
