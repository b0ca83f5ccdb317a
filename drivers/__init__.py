"""The CANopen stack: bus, CiA 301, CiA 402, device profiles, the master and the simulated module."""
