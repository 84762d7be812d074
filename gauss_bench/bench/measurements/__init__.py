"""The measurements: each file turns parts of a suite into tasks, and each task returns rows of tables."""
