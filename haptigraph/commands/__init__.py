"""The commands, grouped by purpose; `cli` assembles them."""
