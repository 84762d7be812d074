"""Edit a drawing; every edit is a step of the history."""
