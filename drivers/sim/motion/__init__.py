"""One simulated axis: its drive, ramps, homing and the mechanics it moves. No I/O, no clock, no ticker."""
