"""Clothes: what is worn, how it is cut, how it falls."""
