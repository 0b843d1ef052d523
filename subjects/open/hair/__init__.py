"""Hair and hats: locks on a posed head."""
