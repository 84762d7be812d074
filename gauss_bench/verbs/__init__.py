"""The subcommands that do more than call one public function, and the files that subcommands write."""
