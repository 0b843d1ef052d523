"""One HTML file that shows what a folder holds, with nothing to fetch."""
