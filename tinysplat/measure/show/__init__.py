"""How rows are shown: tables, plots, sheets of pictures, reports, and the marked places of README and docs."""
