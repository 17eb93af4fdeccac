"""Controls as MIDI, to a port or into a file, and a way to learn which goes where."""
