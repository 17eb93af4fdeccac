"""The design tool in the browser: it edits a device's folder, and runs what commands run."""
