"""The wire models: every number names its unit."""
