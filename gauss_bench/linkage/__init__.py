"""From a linkage file to a Mechanism: its grammar, its faults, and its first assembly."""
