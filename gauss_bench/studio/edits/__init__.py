"""Edits of a drawing, and how an edit becomes a step of the history."""
