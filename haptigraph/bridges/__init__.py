"""Tell other systems live what a run sees, concludes and makes felt. A bridge never holds up the loop."""
