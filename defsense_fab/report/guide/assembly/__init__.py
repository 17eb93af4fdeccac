"""Plan how to assemble a device: actions, their order, the steps and their instructions."""
