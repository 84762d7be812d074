"""What is run, as data: each suite is a file of linkages, engines, steps and targets, read and checked in one place."""
