"""`Idempotency-Key`: a command that is sent twice is carried out once."""
