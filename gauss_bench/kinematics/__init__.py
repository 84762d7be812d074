"""How a linkage moves, without forces: loops, point coordinates, singular positions."""
