"""The documentation inside the site of a report: its pages, and the parts of them that are computed from code."""
