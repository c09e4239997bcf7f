"""One foreign thing a module: file formats, the engine, the workspace's packages."""
