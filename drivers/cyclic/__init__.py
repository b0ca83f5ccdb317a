"""Set points sent on a cycle with SYNC: what each cycle sends, and who keeps the time. Knows no drive."""
