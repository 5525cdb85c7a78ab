"""The commands, grouped by what they are for; `cli` puts them together."""
