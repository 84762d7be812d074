"""Rows -> pages: tables, pictures and sentences of one run. Knows what a linkage looks like, and nothing of how one is computed."""
