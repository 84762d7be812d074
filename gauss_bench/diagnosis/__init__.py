"""What is wrong with an engine, and whether the suite would notice: see README.md."""
