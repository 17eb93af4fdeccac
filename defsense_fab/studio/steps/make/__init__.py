"""The step Make: parts, their assembly, lists of materials, and the export."""
