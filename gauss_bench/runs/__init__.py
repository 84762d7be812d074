"""Run one engine once on one mechanism, in this process or in a worker process. Every command does so. See README.md."""
