"""Run suites and write their rows: cases, races, searches and the accuracy gate. See README.md."""
