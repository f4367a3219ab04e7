"""The volumes in the words of others: OME-Zarr with standard codecs, Neuroglancer precomputed."""
