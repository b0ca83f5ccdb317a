"""One drive on the wire: its controlword and parameters, switching on and off, coming to rest."""
