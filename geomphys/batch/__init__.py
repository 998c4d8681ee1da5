"""Many logs through the pipeline: planned, run by processes or a Dask cluster, recorded in a manifest, resumed."""
