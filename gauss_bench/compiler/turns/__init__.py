"""Kinematics over whole turns."""
