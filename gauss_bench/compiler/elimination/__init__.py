"""Solution of the equations of motion by sparse elimination, with pivots that are fixed when code is generated."""
