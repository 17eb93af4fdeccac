"""The pages of the studio: the start page of an empty folder, and the page of a device."""
