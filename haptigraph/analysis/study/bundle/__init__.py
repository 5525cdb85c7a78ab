"""A study as a bundle for a repository such as OSF, which others can check and reproduce."""
