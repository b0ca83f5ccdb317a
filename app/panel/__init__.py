"""The fault panel of the simulator over HTTP: an application of its own, never part of the service."""
