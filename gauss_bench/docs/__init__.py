"""The documentation that lies in the site of a report: pages, and what of them follows from code."""
