"""What of a study may be published, and how a participant is found again in it."""
