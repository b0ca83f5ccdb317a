"""What is decided before a frame is sent: configuration, gearing, PDOs, requests. Values only."""
