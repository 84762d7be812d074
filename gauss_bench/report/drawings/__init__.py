"""Linkages drawn: standing still with their names, moving, and their points as curves."""
