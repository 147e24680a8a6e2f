"""Read every file of a study before any work: contents, problems and fixes."""
