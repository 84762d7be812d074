"""The published site: pages, charts and data from stored rows alone. It works from a local folder and from any web address."""
