"""Commands for many recordings: archive, query, batch."""
