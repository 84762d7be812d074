"""Read a linkage file, check it against the grammar, build its Mechanism, and assemble it."""
