"""The messages between the studio and its page in the browser, declared once."""
