"""Build the interactive 3D view of a build's pages: data, script and style, all in the page."""
