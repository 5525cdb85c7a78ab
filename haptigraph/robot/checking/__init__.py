"""Check the interface of a robot before anything moves: from recorded messages to findings."""
