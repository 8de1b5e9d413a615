"""Images in, cloth state out. Works on arrays only: no files, no simulator.

- ``camera``: pinhole model, intrinsics, fitted table plane, rectified view.
- ``cloth``: segmentation, contact, free edge, and the pipeline that makes a ``ClothState``.
- ``descriptors``: WORD and other descriptors of wrinkles, by name.

Import from the modules themselves.
"""
