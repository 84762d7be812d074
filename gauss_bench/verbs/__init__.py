"""The verbs of the command line that are more than one public function, and the files that verbs write."""
