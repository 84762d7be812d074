"""Simulate one linkage with thousands of values of chosen numbers in its file, and return rows, quantiles and sensitivities."""
