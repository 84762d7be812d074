"""Find the cause of an engine's error, and test with planted faults whether the suite detects errors: see README.md."""
