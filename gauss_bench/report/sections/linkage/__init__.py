"""A chapter for each linkage: what it looks like, and how every engine fares on it."""

PLACE = 10
TITLE, ANCHOR = "Linkages", "linkages"
NOTHING = ""
