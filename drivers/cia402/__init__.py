"""CiA 402 as pure code: statuswords in, controlwords out. No I/O, and time only as an argument."""
