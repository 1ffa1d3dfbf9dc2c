"""Run folders: ledger, manifest, Parquet shards, result files, checks of untrusted files."""
