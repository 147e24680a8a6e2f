"""The page of a study, its answer, its viewer and its figures."""
