"""Figures, diagrams and tables of runs, procedures and proofs."""
