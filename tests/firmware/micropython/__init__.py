"""Tests of the MicroPython program, in MicroPython and in CPython."""
