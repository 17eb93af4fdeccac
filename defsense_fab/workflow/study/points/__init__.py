"""What is studied: `study.toml`, its parameters, and the points that its design makes of them."""
