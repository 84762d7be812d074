"""The equations solved: sparse elimination with pivots fixed at generation."""
