"""The live loop: samples in, frames out; and the files of a run."""
