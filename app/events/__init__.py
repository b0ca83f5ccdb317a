"""The event streams, and the journal in the log."""
