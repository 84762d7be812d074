"""What a linkage is: its data, its constraints and its forces, in absolute planar coordinates."""
