"""The service's HTTP contract, without I/O and without waiting: what is sent, and what an answer means."""
