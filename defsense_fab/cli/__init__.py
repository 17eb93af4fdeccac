"""The command `defsense`: one file a group of commands."""
