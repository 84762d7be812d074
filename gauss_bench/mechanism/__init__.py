"""The mechanism: links, joints and forces as frozen data, its constraints and its energy, in absolute planar coordinates."""
