"""Recommendations: the cheapest setting of each engine that meets an accuracy requirement within a time budget. See README.md."""
