"""An axis: its status, its readiness, switching it on and off, its units."""
