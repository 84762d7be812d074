"""The published site: pages, charts and data from stored rows alone. The site works from a local folder and from any web address.
"""
