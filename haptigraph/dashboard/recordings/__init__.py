"""The recordings page."""
