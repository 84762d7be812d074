"""The sections of the report, each in a file; `report/build.py` describes the functions of such a file."""
