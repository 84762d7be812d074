"""The studio: draw, drag and watch a linkage on a page that this machine serves; README.md has a map and the protocol."""
