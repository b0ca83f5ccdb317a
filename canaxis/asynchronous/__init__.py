"""The client for an event loop, and the source of the one for plain Python: see docs/decisions."""
