"""How rows are shown: tables, sheets of pictures, reports, and the marked places of README and docs."""
