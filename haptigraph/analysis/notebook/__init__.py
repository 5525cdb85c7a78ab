"""What notebooks show of runs, steps, graphs and procedures: tables, figures, DataFrames."""
