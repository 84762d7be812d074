"""The verbs of the command line that are not single public functions, and the files that verbs write."""
