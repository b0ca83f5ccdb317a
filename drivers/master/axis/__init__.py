"""What an axis does now: what it may do, what it is busy with, what waits."""
