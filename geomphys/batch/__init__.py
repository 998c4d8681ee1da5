"""Replays many logs, in processes or on a Dask cluster, with a manifest that allows a batch to be resumed."""
