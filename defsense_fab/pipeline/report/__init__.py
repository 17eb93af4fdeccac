"""What pages and PDFs share: templates, pictures."""
