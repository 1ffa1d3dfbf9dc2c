"""Speed and accuracy beside each other: `bench` measures a scene on this machine, part by part,
into a folder."""
