"""The device on a page in the browser, as it moves."""
