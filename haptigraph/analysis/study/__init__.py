"""Study reports: statistics, figures and one page from tables and recordings. Needs the extra `study`."""
