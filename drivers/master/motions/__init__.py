"""The ways to move one drive, one file each, and what they have in common."""
