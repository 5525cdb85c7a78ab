"""Find motions of the needle about its trocar that lead to another state."""
