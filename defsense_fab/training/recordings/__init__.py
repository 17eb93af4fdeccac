"""Read datasets from sessions and from files of other systems; write datasets."""
