"""The digital twin: simulated cords, boards, cameras and hands, to work without hardware."""
