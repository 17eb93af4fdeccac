"""What the live loop sends to other programs and devices, each by a plug behind one interface."""
