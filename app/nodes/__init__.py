"""The modules on the bus: what they are, how they booted, their emergencies."""
