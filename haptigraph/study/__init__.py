"""Studies: a protocol as data, who gets what in which order, store and runner; simulated participants."""
