"""Simulated intraoperative OCT: B-scans of a needle at the retina."""
