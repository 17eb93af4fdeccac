"""The folder of a device that is being designed: its file, its history and script consent."""
