"""The report of a results folder: tables, figures, LaTeX and one HTML page."""
