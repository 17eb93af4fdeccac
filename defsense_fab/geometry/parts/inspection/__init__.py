"""What finished parts are measured for before anything is written."""
