"""A mechanism as frozen data, with its constraint rows, forces and energy in absolute planar coordinates."""
