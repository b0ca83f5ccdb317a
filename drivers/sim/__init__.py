"""The simulated module: a CANopen slave written for itself, for demos, tests and whoever has no hardware."""
