"""One flight at a time: its options, its environment, who flies it, its pictures, and its file."""
