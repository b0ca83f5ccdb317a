"""What every room of the master stands on: its times, its counters, the router, where an error belongs."""
