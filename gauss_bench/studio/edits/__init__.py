"""Edits: places and tables while they change, and a change as a step of the history."""
