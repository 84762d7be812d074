"""An engine over its releases: each is installed into an environment of its own, asked the same questions, and compared.

`library` reads which releases there are, `environments` installs them, `cases` says what is asked, `asking` asks one release,
`compare` finds what differs between neighbours, `costs` races them, and `table` makes rows of it.
"""
