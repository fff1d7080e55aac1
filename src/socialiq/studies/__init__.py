"""Studies: one folder for each table or figure of the thesis, and for each question beyond it."""
