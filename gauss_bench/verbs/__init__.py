"""Run the subcommands that do more than call one public function, and write the files of subcommands."""
