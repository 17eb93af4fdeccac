"""Train, select and recalibrate decoders; derive fault limits and repeatability."""
