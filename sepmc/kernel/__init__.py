"""What the kernel of a scene is made of: its structure, and the recorder that writes it down."""
