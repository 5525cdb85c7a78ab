"""What a study comes to: its tables and recordings become statistics, figures and one page. Extra `study`."""
