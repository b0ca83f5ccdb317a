"""Coordinated moves: axes that start on one SYNC and arrive together."""
