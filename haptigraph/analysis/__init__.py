"""What recordings say: measures, scores against truth, figures."""
