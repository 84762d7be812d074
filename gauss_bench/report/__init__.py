"""Tables, pictures and sentences of one run, computed from its rows. This package draws linkages, and computes no motion."""
