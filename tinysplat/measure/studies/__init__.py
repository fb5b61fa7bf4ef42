"""Questions, one a module: what each measures, and the tables and plots that answer it. None imports another."""
