"""The published site: pages, charts and data from stored rows alone. It opens from a folder or from any address."""
