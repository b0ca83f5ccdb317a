"""What is particular to one model of module: its object dictionary, error table and features, as data."""
