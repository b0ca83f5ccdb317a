"""What the bus told us, with its age: statuses, emergencies, events, evidence."""
