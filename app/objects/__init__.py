"""Raw access to the object dictionary."""
