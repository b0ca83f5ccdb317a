"""CiA 301 and CiA 305 as pure code: bytes in, values out. No I/O, no clock, standard library only."""
