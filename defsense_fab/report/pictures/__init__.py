"""Pictures of a build, drawn off-screen: what is drawn by VTK, and what is written around it."""
