"""Run one engine once on one mechanism, in this process or in a worker process, for every command. See README.md."""
