"""Robots: read their pose, and move them within limits about a remote centre of motion."""
