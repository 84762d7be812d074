"""The published site: pages, charts and data out of stored rows alone, readable from a folder and under any address."""
