"""What comes out: kept results, the paper's numbers beside ours, the page."""
