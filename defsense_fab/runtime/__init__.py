"""The live loop: readings in; markers, controls and a moving surface out."""
