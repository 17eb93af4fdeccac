"""Results of a build: records of each stage, their files, and `Build`, which reads each once."""
