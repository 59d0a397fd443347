"""Buildings of several storeys and floor plans with known truth, for checks, tables and rooms."""
