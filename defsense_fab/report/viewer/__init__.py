"""The three-dimensional view in a build's pages: data, script and style, all inside the page."""
