"""What outlives the process: one SQLite file, and what each part of the service keeps in it."""
