"""Suites as data: each is a file of linkages, engines, steps and targets, read and checked in one place."""
