"""Simulate one linkage with thousands of values of chosen numbers of its file, and return rows, quantiles and sensitivities."""
