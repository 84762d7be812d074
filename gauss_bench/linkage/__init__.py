"""Read a linkage file and build a Mechanism: the grammar of files, the faults of a file, and the first assembly of a linkage."""
