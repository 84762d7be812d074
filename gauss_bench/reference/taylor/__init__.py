"""The first pipeline of a certificate: index-reduced equations in loop coordinates, integrated by Taylor series in 128 bit.

vector sums -> rows, forces -> equations (elimination) -> compiled series, marched from chart to chart -> samples, joint forces
"""
