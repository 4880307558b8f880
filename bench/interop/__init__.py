"""Open3D's calls beside ours, timed: `python -m bench.interop` prints the table of docs/open3d.md."""
