"""Speed and accuracy beside each other."""
