"""The report on runs: one page with tables against the paper, and its figures."""
