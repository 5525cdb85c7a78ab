"""Human-subject studies: protocol, counterbalancing, store and session runner; simulated participants."""
