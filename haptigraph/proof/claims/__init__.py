"""Claims about a procedure, each over every possible graph, by what they are about."""
