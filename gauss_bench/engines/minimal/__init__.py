"""The equation of motion in one coordinate, for linkages of one degree of freedom whose loops close by dyads. See README.md."""
