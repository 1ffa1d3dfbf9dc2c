"""Run folders: names, files, checksums, manifest, Parquet shards, guards against foreign files."""
