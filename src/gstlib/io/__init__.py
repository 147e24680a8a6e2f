"""Files: meshes, scans, HDF5 between the stages, CSV tables at the end."""
