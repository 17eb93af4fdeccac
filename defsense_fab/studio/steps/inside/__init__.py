"""The step that cuts the body: its strain in a section, and the place of another cord."""
