"""Compare releases of an engine's library: each is installed in an environment of its own and asked the same questions.

`library` lists the releases, `environments` installs them, `cases` and `probes` have the questions, `asking` asks one release,
`compare` finds differences between consecutive releases, `costs` times their steps, and `table` makes rows.
"""
