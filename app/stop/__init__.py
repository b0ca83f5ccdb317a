"""The software stop for everything."""
