"""The report's sections, one file each: a function of the run (and a linkage) to a Section, or None if there is nothing to say."""
