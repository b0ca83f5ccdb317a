"""The SDO channel to one node: bytes and deadlines; it knows no drive."""
