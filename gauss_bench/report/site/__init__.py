"""The published site: pages, charts and data, made from stored rows alone; it opens from a folder or from any address."""
