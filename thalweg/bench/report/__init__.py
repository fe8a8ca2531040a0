"""The report: tables, figures, HTML page and LaTeX."""
