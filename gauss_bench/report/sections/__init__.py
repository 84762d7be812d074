"""The report, section by section: a file each, a room for a chapter; see `report/build.py` for what a file must have."""
