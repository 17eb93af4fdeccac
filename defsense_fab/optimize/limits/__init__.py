"""What a layout must keep: walls, radii, clearances, parts that can be printed."""
