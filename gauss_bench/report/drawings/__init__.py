"""Drawings of linkages: still pictures with names, animations, and curves of runs and points."""
