"""Commands about the program itself: what it needs, and how it is typed."""
