"""The edge to the wire: one frame type, one `Bus` protocol, and the buses that speak it."""
