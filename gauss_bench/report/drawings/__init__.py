"""Drawings of linkages: still with names, animated, and curves of points."""
