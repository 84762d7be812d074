"""Run one engine once on one mechanism, in this process or in a worker process; every verb uses this. See README.md."""
