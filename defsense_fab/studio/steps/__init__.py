"""The steps of the work, each with the requests that it handles."""
