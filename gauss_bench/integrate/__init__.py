"""Stepping a second-order system q'' = acceleration(t, q, v), for any number of coordinates."""
