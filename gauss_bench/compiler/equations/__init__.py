"""The equations of motion of a linkage as nodes of an expression graph."""
