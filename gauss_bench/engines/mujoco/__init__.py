"""MuJoCo: `forces` finds an element for each force, `draft` builds the model, `adapter` runs it, `mjcf` writes it as a document.

`compiled` reads documents of others. `library_calls` times the library alone.
"""
