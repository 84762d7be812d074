"""The studio: a linkage drawn, dragged and watched on a page of this machine; its file is the one truth. See README.md."""
