"""The CAN bus as the API shows it."""
