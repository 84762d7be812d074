"""Measurements, one idea a file: each turns lines of a suite into tasks, and a task into rows of tables."""
