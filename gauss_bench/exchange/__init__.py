"""Linkages on their way out to other programs (`export`) and in from them (`import`); README.md walks through the room."""
