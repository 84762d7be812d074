"""The mechanism: links, joints and forces as frozen data, its constraint rows and its energy, in absolute planar coordinates."""
