"""A study made from files: names, pairs of scans, places on the mesh, the page of `gst place`."""
