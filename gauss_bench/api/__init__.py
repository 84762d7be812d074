"""What the verbs do and say: simulate, compare, kinematics, the options of the command line and the text it prints."""
