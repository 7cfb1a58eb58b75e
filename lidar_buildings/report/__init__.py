"""The page ``report.html`` of a result, and what is said of one of its buildings."""
