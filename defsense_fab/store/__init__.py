"""Results of a build: the records of each stage, their files, and `Build`, which reads each once."""
