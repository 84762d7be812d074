"""Advice: which setting of which engine holds what a user requires of a linkage, within the seconds that he has: see README.md."""
