"""The companion trainer: front and back branches that learn from shards."""
