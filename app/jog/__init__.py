"""Jogging over a WebSocket: who holds, and what is said to them. What turns and stops is the axis's own."""
