"""The studio: draw, drag and watch a linkage on a page that this machine serves; README.md lists the files and has the protocol."""
