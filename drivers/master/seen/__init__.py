"""What was seen, with its age: statuses, emergencies, events, evidence, what became of a boot-up."""
