"""Speed measurements of every part."""
