"""The command `defsense`: a folder for each task, one file a group of commands."""
