"""The web dashboard: the server beside the loop, its pages, and their jobs."""
