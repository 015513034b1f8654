"""Plants made by other formulas, forms, protocols and instruments than the laboratory's own."""
