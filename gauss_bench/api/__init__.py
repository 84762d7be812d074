"""The verbs: simulate, compare, kinematics, the options of the command line and the text it prints."""
