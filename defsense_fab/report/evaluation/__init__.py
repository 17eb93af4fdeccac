"""Write evaluations of trained models: pages, figures and tables."""
