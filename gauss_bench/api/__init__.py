"""The public functions, such as `simulate` and `compare`, the options of the command line, and the texts that it prints."""
