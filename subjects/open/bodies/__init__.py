"""Bare bodies: their shapes, faces, poses, and how an estimator would see them."""
