"""Claims about touch: what is felt, how alarms differ from all else, and what follows a measure."""
