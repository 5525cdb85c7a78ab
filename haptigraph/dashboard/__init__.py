"""The live page: a server beside the loop, and the pages it serves."""
