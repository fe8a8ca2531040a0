"""Records that describe what to render: camera, appearance, randomisation and scene tables."""
