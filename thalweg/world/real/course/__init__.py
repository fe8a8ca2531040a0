"""From the features of a file to the course of a river with its bridges and islands."""
